//! The controlled end of the loop: stop, hold, drives off; every wait has a time limit.
//!
//! ```text
//!  running ──end asked for: Stop──► stopping ──at rest, or time over: Disable──► disabling ──► over
//! ```
//!
//! From `stopping` on, no client is followed and no other request is carried out. A second signal
//! changes nothing, and neither does a fault: the limits are counted in cycles since the first.

use robot_state::{CycleRecord, RobotState};
use supervisor::OperatorRequest;

/// |dq| below which a joint of a robot in a fault counts as at rest, over that of other states.
const REST: f64 = 2.5;
/// Time for which control words that switch the drives off are sent, s.
const DISABLE_S: f64 = 0.1;

/// The phases of the loop's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Running,
    Stopping,
    Disabling,
    Over,
}

/// State machine of the loop's controlled end.
#[derive(Debug, Clone)]
pub struct Ending {
    phase: Phase,
    /// Cycles left of the phase.
    left: u64,
    stop_cycles: u64,
    disable_cycles: u64,
    /// |dq| below which each joint counts as at rest, rad/s.
    rest: Vec<f64>,
}

impl Ending {
    /// `time_limit`: longest time to bring the robot to rest, s; `rest`: |dq| below which each joint
    /// counts as at rest, rad/s.
    #[must_use]
    pub fn new(time_limit: f64, sample_period: f64, rest: Vec<f64>) -> Self {
        let cycles = |time: f64| (time / sample_period).ceil() as u64;
        Self {
            phase: Phase::Running,
            left: 0,
            stop_cycles: cycles(time_limit),
            disable_cycles: cycles(DISABLE_S),
            rest,
        }
    }

    /// Cycles that the end takes if the robot is at rest.
    #[must_use]
    pub fn least_cycles(&self) -> u64 {
        self.disable_cycles + 1
    }

    /// The request of the coming cycle; `begun`: cycles that have begun or been skipped since the
    /// last call, `last`: the record of the last one.
    pub fn advance(
        &mut self,
        asked: bool,
        begun: u64,
        last: &CycleRecord,
    ) -> Option<OperatorRequest> {
        self.left = self.left.saturating_sub(begun);
        match self.phase {
            Phase::Running if asked => {
                (self.phase, self.left) = (Phase::Stopping, self.stop_cycles);
                Some(OperatorRequest::Stop)
            }
            Phase::Stopping if self.left == 0 || is_at_rest(last, &self.rest) => {
                (self.phase, self.left) = (Phase::Disabling, self.disable_cycles);
                Some(OperatorRequest::Disable)
            }
            Phase::Disabling if self.left == 0 => {
                self.phase = Phase::Over;
                None
            }
            _ => None,
        }
    }

    /// Whether clients are followed and their requests carried out.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.phase == Phase::Running
    }

    /// Whether the end is over: no further cycle is to be run.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.phase == Phase::Over
    }
}

/// Whether the robot is at rest. In a fault it may still be braking; in all other states the state
/// machine knows.
fn is_at_rest(record: &CycleRecord, rest: &[f64]) -> bool {
    let mut joints = record.measured.joints.iter().zip(rest);
    match RobotState::from_number(record.state) {
        Some(RobotState::Stopping | RobotState::Active) => false,
        Some(RobotState::Fault) => joints.all(|(joint, rest)| joint.dq.abs() < REST * rest),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(state: RobotState, dq: f64) -> CycleRecord {
        let mut record = CycleRecord {
            state: state.number(),
            joint_count: 1,
            ..CycleRecord::default()
        };
        record.measured.joints[0].dq = dq;
        record
    }

    #[test]
    fn the_robot_is_stopped_then_disabled() {
        let mut ending = Ending::new(2.0, 0.001, vec![0.02]);
        let active = record(RobotState::Active, 1.0);
        assert_eq!(ending.advance(false, 1, &active), None);
        assert_eq!(
            ending.advance(true, 1, &active),
            Some(OperatorRequest::Stop)
        );
        let stopping = record(RobotState::Stopping, 0.5);
        for _ in 0..100 {
            assert_eq!(ending.advance(true, 1, &stopping), None);
            assert!(!ending.is_running());
        }
        let holding = record(RobotState::Holding, 0.0);
        assert_eq!(
            ending.advance(true, 1, &holding),
            Some(OperatorRequest::Disable)
        );
        let ready = record(RobotState::Ready, 0.0);
        let cycles = (0..1000).take_while(|_| {
            assert_eq!(ending.advance(true, 1, &ready), None);
            !ending.is_over()
        });
        assert_eq!(cycles.count(), 99);
    }

    #[test]
    fn neither_a_joint_that_never_rests_nor_a_fault_prevents_the_end() {
        for state in [RobotState::Stopping, RobotState::Fault, RobotState::Active] {
            let mut ending = Ending::new(2.0, 0.001, vec![0.02]);
            let moving = record(state, f64::NAN);
            let mut requests = Vec::new();
            let mut cycles = 0;
            while !ending.is_over() {
                requests.extend(ending.advance(true, 1, &moving));
                cycles += 1;
                assert!(cycles < 2200, "{state:?}");
            }
            let expected = [OperatorRequest::Stop, OperatorRequest::Disable];
            assert_eq!(requests, expected);
        }
    }
}
