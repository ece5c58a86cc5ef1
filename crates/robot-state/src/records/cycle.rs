//! The record of one cycle, and what shared memory carries of it.

use super::{CommandedRecord, CommanderRecord, EstimatedRecord, MeasuredRecord};
use crate::event::EVENT_COUNT;
use crate::layout::record;

record! {
    /// Everything that one cycle measured, estimated and commanded: one group for each stage of the
    /// loop, written by that stage alone.
    pub struct CycleRecord {
        /// Cycle number since start.
        pub sequence: u64,
        /// Instant of the cycle, ns on the caller's clock.
        pub stamp_ns: u64,
        /// Number of a `Mode`, that of this cycle: 0 hold, 1 torque, 2 inverse dynamics, 3
        /// position, 4 Cartesian.
        pub mode: u32,
        /// Number of the latched fault's event, or 0.
        pub fault: u32,
        /// Number of a `RobotState`: 0 boot, 1 ready, 2 enabling, 3 holding, 4 active, 5 stopping,
        /// 6 fault.
        pub state: u32,
        /// Operators' requests since start.
        pub requests: u32,
        /// Why the last request was refused, or 0: its kind (1 state, 2 joint not plausible, 3
        /// joint outside its limits, 4 another fault, 5 a drive's own fault) times 65536, plus the
        /// number of the state or fault, or the joint's index.
        pub refusal: u32,
        /// The subject of the latched fault, or 0 if it has none: its kind (1 joint, 2 F/T sensor, 3
        /// IMU) times 65536, plus its index.
        pub fault_subject: u32,
        /// Modes that the sources allow at present, a bit for each number of a `Mode`.
        pub possible_modes: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// The client that commands.
        pub commander: CommanderRecord,
        /// Joints in use.
        pub joint_count: u32,
        /// F/T sensors in use.
        pub ft_count: u32,
        /// Measured values.
        pub measured: MeasuredRecord,
        /// Torques and contact wrenches estimated from them.
        pub estimated: EstimatedRecord,
        /// Commands to the drives.
        pub commanded: CommandedRecord,
        /// Count of each event since start, in the order of `Event::ALL`.
        pub events: [u64; EVENT_COUNT],
    }
}

record! {
    /// Timing and traffic of the loop around the cycle.
    pub struct LoopRecord {
        /// Cycles run.
        pub cycles: u64,
        /// Cycles that ended after the next one should have begun.
        pub late_cycles: u64,
        /// Cycles that were left out because an earlier one ended too late.
        pub skipped_cycles: u64,
        /// Lateness of the thread's wake-up, ns.
        pub wake_late_ns: u64,
        /// Time from SYNC until every joint had answered or the deadline had passed, ns.
        pub gather_ns: u64,
        /// Computing time of the cycle, ns.
        pub compute_ns: u64,
        /// Time to hand the commands to the bus, ns.
        pub send_ns: u64,
        /// Frames received since start.
        pub frames_received: u64,
        /// Frames sent since start.
        pub frames_sent: u64,
    }
}

record! {
    /// The record that shared memory carries each cycle.
    pub struct SharedRecord {
        /// The cycle.
        pub cycle: CycleRecord,
        /// The loop around it.
        pub timing: LoopRecord,
    }
}
