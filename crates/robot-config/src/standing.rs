//! Standing: what a robot needs for mode stand.

use crate::Robot;
use control::Stepping;
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
    /// Steps in place of a robot that stands at `pose` (rad or m, config order), whose feet rise so far, m; none for a
    /// robot with less than two feet that can.
    #[must_use]
    pub fn stepping(&self, pose: &[f64], rise: f64) -> Option<Stepping> {
        let p = &self.parameters;
        let places: Vec<usize> = p.joints.iter().map(|joint| joint.model_index).collect();
        let feet = p.ft_sensors.iter().enumerate();
        let feet = feet.filter(|(_, ft)| ft.sole.is_some());
        let feet = feet.filter_map(|(s, ft)| Some((s, self.model.frame_index(&ft.sensor.frame)?)));
        let feet: Vec<(usize, usize)> = feet.collect();
        Stepping::new(&self.model, &places, &feet, pose, rise)
    }
}
