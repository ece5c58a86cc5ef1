//! What clients ask for now and then, and what the daemon answers.

use crate::layout::record;
use crate::name::{Name, Text};
use crate::records::{MAX_FT_SENSORS, Wrench};

/// What a request asks for.
pub mod request {
    /// Averages the robot at rest and takes the F/T sensors' offsets over; `contacts` says what
    /// touches the robot.
    pub const TARE: u32 = 1;
    /// Tells the last tare.
    pub const SHOW_TARE: u32 = 2;
    /// Offsets of the configuration alone, as if there had never been a tare.
    pub const FORGET_TARE: u32 = 3;
    /// From now on the robot has the contacts of the set `contacts`.
    pub const CHOOSE_CONTACTS: u32 = 4;
    /// From now on the automatic rule chooses the set of contacts.
    pub const AUTOMATIC_CONTACTS: u32 = 5;
}

/// How far a request is.
pub mod answer_status {
    /// Another answer follows.
    pub const WORKING: u32 = 1;
    /// Done; the last answer.
    pub const DONE: u32 = 2;
    /// Nothing was changed; `text` says why. The last answer.
    pub const REFUSED: u32 = 3;
}

record! {
    /// What a client asks for; any client may, at any time.
    pub struct Request {
        /// Any number that no other request has: answers carry it.
        pub id: u64,
        /// One of `request`.
        pub kind: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// Name of a set of contacts, for a tare and for the choice of contacts.
        pub contacts: Name,
    }
}

record! {
    /// The offset of one F/T sensor.
    pub struct TaredSensor {
        /// What a tare takes off the sensor's reading besides the config's offset.
        pub offset: Wrench,
        /// The same before this request.
        pub before: Wrench,
        /// Standard deviation of `offset`; zero without a tare.
        pub sigma: Wrench,
        /// Bit k: the pose has told component k (fx fy fz tx ty tz) of `offset`.
        pub known: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// What the daemon answers: as long as it works ten times a second, and once at the end.
    pub struct Answer {
        /// The request's.
        pub id: u64,
        /// One of `answer_status`.
        pub status: u32,
        /// F/T sensors in use.
        pub ft_count: u32,
        /// How much is done, 0 to 1.
        pub progress: f64,
        /// When the tare was taken, seconds since 1970-01-01 UTC; zero: there is none.
        pub date_unix_s: f64,
        /// The set of contacts of that tare.
        pub contacts: Name,
        /// What is being done, was done, or keeps it from being done.
        pub text: Text<1024>,
        /// The F/T sensors, in config order; told by tares.
        pub ft: [TaredSensor; MAX_FT_SENSORS],
    }
}
