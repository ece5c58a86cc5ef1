//! Standing: what a robot needs for mode stand.

use crate::Robot;
use dynamics::Base;
use problem::Problem;

impl Robot {
    /// What this robot lacks for mode stand; nothing: it has the mode.
    #[must_use]
    pub fn cannot_stand(&self) -> Option<Problem> {
        let p = &self.parameters;
        let lacks = |what: &str, allowed: &str| Some(Problem::new(what, allowed).of("mode stand"));
        if self.model.base() == Base::Fixed {
            return lacks(
                "the robot's base is fixed",
                "base = \"floating\" in [robot]",
            );
        }
        if p.whole_body.stand.is_some() {
            return lacks("a stand carries the robot", "no table [fixed_base]");
        }
        if p.ft_sensors.is_empty() {
            return lacks(
                "no foot has an F/T sensor",
                "an [[ft_sensor]] above each foot",
            );
        }
        if p.ft_sensors.iter().all(|ft| ft.sole.is_none()) {
            return lacks(
                "no foot's sole is known, and so not where the robot may stand",
                "sole_corners_m of the [[ft_sensor]] above each foot",
            );
        }
        None
    }
}
