//! Steps: an angle that leaves its course from one sample to the next and goes on beside it.

/// Share of the way since the last sample by which instants of sampling may make the next one differ.
pub(super) const JITTER: f64 = 0.25;

/// A step of an angle between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    None,
    /// It may be one: the next sample shows.
    Pending,
    Confirmed,
}

/// An angle and its change per sample, before a step that the next sample confirms or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Course {
    pub(super) angle: f64,
    pub(super) rate: f64,
}

/// Follows the course of an angle.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Steps {
    /// The last samples in a row.
    last: Option<f64>,
    pub(super) course: Option<Course>,
    /// The course that the last sample left by a step, and the least angle that counts as one.
    left: Option<(Course, f64)>,
}

impl Steps {
    /// Whether the angle has left its course by more than `least`, or by a share of its way.
    pub(super) fn follow(&mut self, angle: f64, least: f64, jitter: f64) -> Step {
        let Some(last) = self.last.replace(angle) else {
            return Step::None;
        };
        let rate = angle - last;
        let course = self.course.replace(Course { angle, rate });
        if let Some((left, step)) = self.left.take() {
            // The same course as before, shifted: a position has jumped.
            let same_rate = (rate - left.rate).abs() < 0.5 * step;
            let shifted = (angle - left.angle - 2.0 * left.rate).abs() > step;
            if same_rate && shifted {
                return Step::Confirmed;
            }
            return Step::None;
        }
        let Some(course) = course else {
            return Step::None;
        };
        let step = least + jitter * course.rate.abs();
        if (rate - course.rate).abs() > step {
            self.left = Some((course, step));
            return Step::Pending;
        }
        Step::None
    }
}
