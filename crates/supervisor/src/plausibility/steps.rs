//! Steps: an angle that leaves its course from one sample to the next and goes on beside it.

/// Share of the way since the last sample by which instants of sampling may make the next one differ.
/// Chosen; no experiment recorded.
pub(super) const JITTER: f64 = 0.25;

/// A step of an angle between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Step {
    None,
    /// The sample may be a step: the next one shows.
    Pending,
    Confirmed,
}

/// An angle and its change per sample, before a step that the next sample confirms or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Course {
    pub(super) angle: f64,
    pub(super) rate: f64,
}

/// An angle that has left its course.
#[derive(Debug, Clone, Copy)]
struct Left {
    /// The course before.
    course: Course,
    /// The least angle that counts as a step; none where it was less.
    step: Option<f64>,
    /// The least angle by which it is beside its course.
    beside: f64,
}

/// Least angles beside a course: of a sample that is not used until the next one shows what it was, and of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Least {
    pub(super) beside: f64,
    pub(super) step: f64,
    /// Share of the way since the last sample that counts to neither.
    pub(super) jitter: f64,
}

/// Follows the course of an angle.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Steps {
    /// The last samples in a row.
    last: Option<f64>,
    pub(super) course: Option<Course>,
    /// The last sample left its course.
    left: Option<Left>,
    /// The course before the last sample.
    before: Option<Course>,
}

impl Steps {
    /// Whether the angle has left its course.
    pub(super) fn follow(&mut self, angle: f64, least: Least) -> Step {
        let Some(last) = self.last.replace(angle) else {
            return Step::None;
        };
        let rate = angle - last;
        let course = self.course.replace(Course { angle, rate });
        let before = std::mem::replace(&mut self.before, course);
        let beside = |from: &Course| (angle - from.angle - 2.0 * from.rate).abs();
        if let Some(left) = self.left.take() {
            let shift = beside(&left.course);
            // The course from before, shifted: a position has jumped.
            let stepped = left
                .step
                .is_some_and(|step| (rate - left.course.rate).abs() < 0.5 * step && shift > step);
            if stepped {
                return Step::Confirmed;
            }
            if shift <= left.beside {
                self.go_on_from(left.course, angle);
            }
            return Step::None;
        }
        let Some(course) = course else {
            return Step::None;
        };
        let jitter = least.jitter * course.rate.abs();
        let [small, step] = [least.beside + jitter, least.step + jitter];
        let off = (rate - course.rate).abs();
        if off <= small {
            return Step::None;
        }
        if let Some(before) = before.filter(|before| beside(before) <= 0.5 * off) {
            // The last sample was beside the course, by too little to be in doubt, and this one is on it again.
            self.go_on_from(before, angle);
            return Step::None;
        }
        self.left = Some(Left {
            course,
            step: (off > step).then_some(step),
            beside: small,
        });
        Step::Pending
    }

    /// The angle is on this course of two samples ago: the one between was wrong.
    fn go_on_from(&mut self, course: Course, angle: f64) {
        let rate = 0.5 * (angle - course.angle);
        (self.course, self.before) = (Some(Course { angle, rate }), None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST: Least = Least {
        beside: 1.0,
        step: 3.0,
        jitter: 0.0,
    };

    fn course(angles: &[f64]) -> Vec<Step> {
        let mut steps = Steps::default();
        angles.iter().map(|&x| steps.follow(x, LEAST)).collect()
    }

    /// One wrong sample, whatever its size, puts no right one in doubt.
    #[test]
    fn a_sample_beside_the_course_is_the_only_one_in_doubt() {
        for size in [0.4, 0.9, 1.1, 1.6, 2.9, 3.1, 50.0] {
            for rate in [0.0, 0.7, -20.0] {
                let at = |k: usize| rate * k as f64 + if k == 4 { size } else { 0.0 };
                let angles: Vec<f64> = (0..12).map(at).collect();
                let mut expected = [Step::None; 12];
                if size > LEAST.beside {
                    expected[4] = Step::Pending;
                }
                assert_eq!(course(&angles), expected, "{size}, {rate}");
            }
        }
    }

    #[test]
    fn only_a_step_that_stays_is_one_and_from_its_least_size_on() {
        let shifted = |size: f64| -> Vec<f64> {
            (0..12)
                .map(|k| 0.3 * f64::from(k) + if k >= 4 { size } else { 0.0 })
                .collect()
        };
        assert_eq!(course(&shifted(3.1))[5], Step::Confirmed);
        assert!(!course(&shifted(2.9)).contains(&Step::Confirmed));
        // An impact changes a velocity.
        let hit: Vec<f64> = (0..12).map(|k| 2.0 * f64::from((k - 4).max(0))).collect();
        let doubted = course(&hit);
        assert!(!doubted.contains(&Step::Confirmed), "{doubted:?}");
        assert_eq!(doubted.iter().filter(|s| **s == Step::Pending).count(), 1);
    }
}
