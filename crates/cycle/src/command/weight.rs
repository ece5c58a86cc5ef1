//! Weight: what loads the robot besides its own mass, some time ago.
//!
//! A sensor is found to have failed some time after it did. What a reaction to it relies on must be
//! older: gravity in the axes of the base (IMU) and the contact wrenches (F/T sensors) are means over
//! blocks of time, of which the last but one counts. Nothing is added while a sensor or a joint is
//! known not to be sound.

use robot_state::{MAX_FT_SENSORS, MeasuredRecord, Wrench, measured_flags};

/// Length of a block, s: what counts is 0.1 to 0.3 s old.
const BLOCK: f64 = 0.1;
/// Signals with one of these say nothing about loads.
const UNSOUND: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::JUMP
    | measured_flags::STALE
    | measured_flags::SETTLING
    | measured_flags::IMPLAUSIBLE
    | measured_flags::FLAT
    | measured_flags::SATURATED;

/// Every joint and sensor of this cycle is sound.
pub(super) fn is_sound(measured: &MeasuredRecord) -> bool {
    // Places that the robot does not use have no flags.
    let joints = measured
        .joints
        .iter()
        .fold(0, |all, joint| all | joint.flags);
    let sensors = (measured.ft.iter()).fold(measured.imu.flags, |all, ft| all | ft.flags);
    // A sensor with a clock of its own misses cycles rightly.
    (joints | sensors & !measured_flags::MISSED) & UNSOUND == 0
}

/// Proper acceleration of the root, m/s², and the contact wrench at each F/T sensor.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Loads {
    pub(super) acceleration: [f64; 3],
    pub(super) contact: [Wrench; MAX_FT_SENSORS],
}

impl Loads {
    /// `self + share other`.
    fn plus(&self, other: &Self, share: f64) -> Self {
        let wrench = |s: usize| {
            let (a, b) = (self.contact[s].to_array(), other.contact[s].to_array());
            Wrench::from_array(std::array::from_fn(|i| a[i] + share * b[i]))
        };
        let (a, b) = (self.acceleration, other.acceleration);
        Self {
            acceleration: std::array::from_fn(|i| a[i] + share * b[i]),
            contact: std::array::from_fn(wrench),
        }
    }
}

/// The loads over the last blocks.
#[derive(Debug, Default)]
pub(super) struct Past {
    cycles_of_block: u32,
    cycles: u32,
    now: Loads,
    sum: Loads,
    /// Means of the last block and of the one before.
    blocks: [Option<Loads>; 2],
}

impl Past {
    pub(super) fn new(sample_period: f64) -> Self {
        Self {
            cycles_of_block: (BLOCK / sample_period).ceil().max(1.0) as u32,
            ..Self::default()
        }
    }

    /// Takes the loads of this cycle.
    pub(super) fn update(&mut self, now: Loads, sound: bool) {
        self.now = now;
        if !sound {
            return;
        }
        self.sum = self.sum.plus(&now, 1.0);
        self.cycles += 1;
        if self.cycles >= self.cycles_of_block {
            let mean = Loads::default().plus(&self.sum, f64::from(self.cycles).recip());
            self.blocks = [Some(mean), self.blocks[0]];
            (self.sum, self.cycles) = (Loads::default(), 0);
        }
    }

    /// The loads some time ago; after a start the oldest ones known.
    pub(super) fn loads(&self) -> &Loads {
        let [last, before] = &self.blocks;
        before.as_ref().or(last.as_ref()).unwrap_or(&self.now)
    }
}
