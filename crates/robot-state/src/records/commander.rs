//! The commanding client, and whether it is followed: what records and every commander get to see.

use crate::layout::record;

/// Reasons for which a reference is refused: its session does not have the lease.
pub mod lease_refusal {
    /// Another session of the same or a higher priority has the lease.
    pub const HELD: u32 = 1;
    /// The session does not have the lease, and only one that asks for hold gets it.
    pub const HOLD_FIRST: u32 = 2;
    /// The session is older than one that has had the lease since; e.g. it had it itself.
    pub const OLD_SESSION: u32 = 3;
    /// Sequence or time of sending do not advance.
    pub const NOT_ADVANCED: u32 = 4;
    /// It was sent longer ago than `loop.reference_timeout_ms`.
    pub const TOO_OLD: u32 = 5;
    /// Its session is 0, or began after it was sent.
    pub const INVALID: u32 = 6;
}

/// Reasons for which no mode of the commander is followed.
pub mod not_followed {
    /// A fault is latched.
    pub const FAULT: u32 = 1;
    /// The robot is in a state without modes.
    pub const STATE: u32 = 2;
    /// The commander must ask for hold first: after an event that has released the robot, or after
    /// an operator's request.
    pub const HOLD_FIRST: u32 = 3;
    /// The joints' filters are not full yet.
    pub const NOT_READY: u32 = 4;
    /// The mode needs a source that is not ready, or that an event speaks against: see
    /// `CycleRecord::possible_modes`.
    pub const NOT_POSSIBLE: u32 = 5;
}

/// Reasons for which a piece of a trajectory is refused; what was buffered before stands.
pub mod piece_refusal {
    /// Its session does not have the lease.
    pub const SESSION: u32 = 1;
    /// Joints, points or spacing are not those of a piece of this robot, or a number is not finite.
    pub const INVALID: u32 = 2;
    /// A point is beyond a joint's limits of position, velocity or acceleration, or cannot be reached
    /// within them from the one before.
    pub const LIMIT: u32 = 3;
    /// Its sequence does not advance.
    pub const NOT_ADVANCED: u32 = 4;
    /// Its first point is not ahead of the present time, or the trajectory has ended.
    pub const LATE: u32 = 5;
    /// Its first point lies beyond the end of what is buffered.
    pub const GAP: u32 = 6;
    /// At its first point it is not where the buffered trajectory is: joining them would take too
    /// much acceleration.
    pub const APART: u32 = 7;
    /// Its last point lies further ahead than a trajectory may be buffered.
    pub const TOO_FAR: u32 = 8;
    /// Another trajectory is being followed, and has not come to rest.
    pub const BUSY: u32 = 9;
}

record! {
    /// The lease of the command. The loop decides on it; the cycle adds what it does with the
    /// commander's references.
    pub struct CommanderRecord {
        /// Session that has the lease, or 0.
        pub session: u64,
        /// Instant at which it got the lease, ns on the machine's `CLOCK_MONOTONIC`.
        pub since_ns: u64,
        /// Sequence of its newest reference that the cycle has seen.
        pub sequence: u64,
        /// Session that was refused last, or 0.
        pub refused_session: u64,
        /// Time until the robot is at the target of mode position, s; 0 in other modes.
        pub motion_left_s: f64,
        /// Trajectory that is buffered or followed, or 0.
        pub trajectory: u64,
        /// Sequence of its session's newest piece that was judged, or 0.
        pub piece: u64,
        /// Sequence of the piece that was refused last, or 0.
        pub refused_piece: u64,
        /// Time since the trajectory began, s; 0 before.
        pub trajectory_s: f64,
        /// Time until its last buffered point, s; 0 at rest there.
        pub trajectory_left_s: f64,
        /// Why session `refused_session` was refused: one of `lease_refusal`.
        pub refused_reason: u32,
        /// References refused since start.
        pub refused: u32,
        /// How often a session of higher priority has taken the lease over since start.
        pub replaced: u32,
        /// Priority of the session that has the lease.
        pub priority: u32,
        /// Its process.
        pub pid: u32,
        /// Why no mode is followed, one of `not_followed`, or 0.
        pub not_followed: u32,
        /// Number of the event that has caused it, or 0, e.g. for an operator's request.
        pub cause: u32,
        /// Why the piece `refused_piece` was refused: one of `piece_refusal`.
        pub piece_refusal: u32,
        /// Pieces of trajectories refused since start.
        pub pieces_refused: u32,
        /// Trajectories that ended in motion since start: no further piece had come.
        pub trajectories_ended: u32,
    }
}

record! {
    /// Report to every commander in each cycle.
    pub struct CommanderStatus {
        /// Cycle number since the daemon's start.
        pub cycle: u64,
        /// The lease, and whether references are followed.
        pub commander: CommanderRecord,
        /// Number of the robot's `RobotState`.
        pub state: u32,
        /// Number of the robot's `Mode`.
        pub mode: u32,
    }
}
