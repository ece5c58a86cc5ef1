//! Inverse dynamics: the joints follow `q_d dq_d ddq_d` and contact wrenches of the client (D12).

use robot_config::Robot;
use robot_state::Mode;

use super::{ClientMode, Made, ModeCycle, Unfit};

#[derive(Debug)]
struct InverseDynamics;

pub(super) fn make(_: &Robot) -> Made {
    Ok(Some(Box::new(InverseDynamics)))
}

impl ClientMode for InverseDynamics {
    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        cycle.body.follow(cycle.asked.reference, cycle.seen);
        cycle.track(Mode::InverseDynamics, cycle.asked, |_, follow| follow);
        Ok(())
    }
}
