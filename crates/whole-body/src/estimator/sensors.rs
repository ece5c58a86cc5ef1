//! What the estimator knows of its F/T sensors.

use super::{WholeBody, wrench};
use nalgebra::Matrix3;
use robot_state::Wrench;

impl WholeBody {
    /// `net` of the part beyond a sensor at that sensor's frame; in the order of the parameters.
    #[must_use]
    pub fn net_at_sensor(&self, sensor: usize) -> Wrench {
        let find = |(_, s): &(usize, &crate::layout::Sensor)| s.input == sensor;
        let sensor = self.layout.sensors.iter().enumerate().find(find);
        sensor.map_or(Wrench::default(), |(s, _)| {
            let frame = self.mechanics.sensor_frame[s];
            wrench(frame.inverse_act_force(self.mechanics.net[s + 1]))
        })
    }

    /// Axes of a sensor's frame in those of the root link, as of the last valid signals; in the order of the
    /// parameters.
    #[must_use]
    pub fn sensor_axes(&self, sensor: usize) -> Matrix3<f64> {
        let mut own = self.layout.sensors.iter();
        let found = own.position(|s| s.input == sensor);
        let frame = found.and_then(|s| self.mechanics.sensor_frame.get(s));
        frame.map_or_else(Matrix3::identity, |frame| frame.rotation)
    }

    /// Per sensor: the joints of the part before it that carry it alone, neither another sensor
    /// nor a contact of the chosen hypothesis, nearest first; both in the parameters' order.
    #[must_use]
    pub fn sensor_limbs(&self) -> Vec<Vec<usize>> {
        let mut limbs = vec![Vec::new(); self.layout.sensors.len()];
        let contacts = &self.sets[self.chosen].contacts;
        for (s, sensor) in self.layout.sensors.iter().enumerate() {
            let others = || (self.layout.sensors.iter().enumerate()).filter(|(i, _)| *i != s);
            let alone = |b: &&usize| {
                !others().any(|(_, o)| o.before == sensor.before && o.carriers.contains(b))
                    && !contacts.iter().any(|c| c.path.contains(b))
            };
            let own = sensor.carriers.iter().filter(alone);
            let joint = |b: &usize| self.model.bodies()[*b].joint;
            let place = |j: usize| self.layout.joints.iter().position(|&own| own == j);
            limbs[sensor.input] = own.map(joint).filter_map(place).collect();
        }
        limbs
    }
}
