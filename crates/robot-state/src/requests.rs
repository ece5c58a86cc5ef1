//! Requests of clients, the daemon's answers, and the settings that follow from them.

use crate::layout::record;
use crate::name::{Name, Text};
use crate::records::{MAX_FT_SENSORS, MAX_JOINTS, Wrench};

/// Kinds of request.
pub mod request {
    /// Determine the F/T sensors' offsets from the robot at rest, touched by the contacts of the
    /// named contact set, and use them.
    pub const TARE: u32 = 1;
    /// Show the last tare.
    pub const SHOW_TARE: u32 = 2;
    /// Use the offsets of the configuration alone, as if there had never been a tare.
    pub const FORGET_TARE: u32 = 3;
    /// Use the named contact set from now on.
    pub const CHOOSE_CONTACT_SET: u32 = 4;
    /// Let the automatic rule choose the contact set from now on.
    pub const AUTOMATIC_CONTACT_SET: u32 = 5;
    /// Switch the drives on, then hold; done when every joint is held.
    pub const ENABLE: u32 = 6;
    /// Send no more set-points and switch the drives off; done when it is so.
    pub const DISABLE: u32 = 7;
    /// Bring the robot to rest, then hold; done when it is at rest.
    pub const STOP: u32 = 8;
    /// Acknowledge the fault of number `fault`; done when it is no longer latched.
    pub const ACKNOWLEDGE: u32 = 9;
    /// Record into the file `path`; done when the file is there. The client must send `RECORDING`
    /// at least every few seconds: else the recording ends.
    pub const RECORD: u32 = 10;
    /// Show the state of the recording; its `progress` is 1 when it has ended.
    pub const RECORDING: u32 = 11;
    /// End the recording; done when the file is whole.
    pub const END_RECORDING: u32 = 12;
    /// Take the torque of joint `joint`, at rest, to be `torque`, with a standard deviation of `sigma`:
    /// its calibrated torsion and motor current get their zeros from it.
    pub const TARE_JOINT: u32 = 13;
}

/// Kinds of refusal of an operator's request by the loop: the upper half of `CycleRecord::refusal`.
pub mod refusal {
    /// Not possible in this state: its number.
    pub const STATE: u32 = 1;
    /// A joint is not plausible or has not been seen: its index.
    pub const JOINT: u32 = 2;
    /// A joint stands outside its position limits: its index.
    pub const OUTSIDE: u32 = 3;
    /// Another fault is latched: its number, or 0 for none.
    pub const OTHER_FAULT: u32 = 4;
    /// A drive reports a fault of its own: its joint's index.
    pub const DRIVE: u32 = 5;
    /// The gear of a joint shows a torsion that does not fit what it bears: its index.
    pub const UNFIT: u32 = 6;
}

/// Progress of a request.
pub mod answer_status {
    /// Another answer follows.
    pub const WORKING: u32 = 1;
    /// Done; the last answer.
    pub const DONE: u32 = 2;
    /// Refused, nothing was changed; `text` gives the reason. The last answer.
    pub const REFUSED: u32 = 3;
}

record! {
    /// A request; any client may send one at any time.
    pub struct Request {
        /// Any number that no other request has: the answers repeat it.
        pub id: u64,
        /// One of `request`.
        pub kind: u32,
        /// Number of the fault to acknowledge; 0 in other requests.
        pub fault: u32,
        /// Name of a contact set, for a tare and for the choice of a contact set.
        pub contact_set: Name,
        /// Duration of a recording from now on, s; negative: until its end is asked for.
        pub seconds: f64,
        /// Time before now that is recorded too, s.
        pub last_s: f64,
        /// tau: torque that the joint is known to carry, N·m, and its standard deviation.
        pub torque: f64,
        /// See `torque`.
        pub sigma: f64,
        /// Messages a second of a recording of torques; 0: one for each cycle.
        pub rate_hz: f64,
        /// Number of a recording's `Content`: 0 all, 1 frames, 2 torques.
        pub content: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// 1: a recording may replace the file `path`.
        pub overwrite: u32,
        /// Index of the joint to tare, in config order.
        pub joint: u32,
        /// Absolute path of the file to record into, as the daemon sees it.
        pub path: Text<1024>,
    }
}

record! {
    /// The tare of one F/T sensor.
    pub struct TaredSensor {
        /// Offset of the tare; it is subtracted from the reading in addition to the
        /// configuration's offset.
        pub offset: Wrench,
        /// The same before this request.
        pub before: Wrench,
        /// Standard deviation of `offset`; zero without a tare.
        pub sigma: Wrench,
        /// Bit k: the tare's pose determined component k (fx fy fz tx ty tz) of `offset`.
        pub known: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// An answer of the daemon: ten a second while it works on the request, and one at the end.
    pub struct Answer {
        /// The request's `id`.
        pub id: u64,
        /// One of `answer_status`.
        pub status: u32,
        /// F/T sensors in use.
        pub ft_count: u32,
        /// Share of the work that is done, 0 to 1.
        pub progress: f64,
        /// Date of the last tare, seconds since 1970-01-01 UTC; zero if there is none.
        pub date_unix_s: f64,
        /// Contact set of that tare.
        pub contact_set: Name,
        /// A sentence about what is being done, was done, or was refused and why.
        pub text: Text<1024>,
        /// The F/T sensors, in config order; filled in answers about tares.
        pub ft: [TaredSensor; MAX_FT_SENSORS],
    }
}

record! {
    /// The last tare of one joint.
    pub struct JointTare {
        /// tau: torque that the joint carried, N·m.
        pub torque: f64,
        /// Its standard deviation, N·m.
        pub sigma: f64,
        /// Count of its tares; 0: none.
        pub count: u64,
    }
}

record! {
    /// Settings that clients' requests change; the loop uses them as soon as they arrive.
    pub struct Settings {
        /// Count of changes.
        pub sequence: u64,
        /// 0: the automatic rule chooses the contact set, or the first one is used where there is
        /// no rule; else the chosen set's index of `Description::contact_set_names`, plus one.
        pub contact_set: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// Offset of the last tare for each F/T sensor, in addition to the configuration's offset.
        pub ft_offset: [Wrench; MAX_FT_SENSORS],
        /// The joints' tares since start, in config order.
        pub joint_tares: [JointTare; MAX_JOINTS],
    }
}
