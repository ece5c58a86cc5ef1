//! Creep of the gear: springs behind dampers in parallel (Maxwell elements).
//!
//! Under a load that stays, the torsion of a gear goes on to grow by some per cent within seconds. Elements beside
//! the elastic gear carry part of each change of the torque and give it up in their relaxation time: the
//! generalised Maxwell model (J. D. Ferry, Viscoelastic Properties of Polymers, Wiley 1980). It dissipates where
//! no stiffness is negative, and is linear in the stiffnesses once the times are chosen. Z, S, G and U have no
//! such state.

/// One spring behind a damper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CreepElement {
    /// T: time in which it relaxes, s.
    pub time: f64,
    /// k: its stiffness, N·m/rad.
    pub stiffness: f64,
}

/// Springs behind dampers, with their stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct Creep {
    /// Stiffness, step of the damper in a sample (1), stretch (rad).
    elements: Vec<(f64, f64, f64)>,
    /// Torsion of the last step, rad; none before the first.
    last: Option<f64>,
    /// Samples without a torsion since then.
    missed: u16,
}

impl Creep {
    /// Relaxed elements; `sample_period` in s.
    #[must_use]
    pub fn new(elements: &[CreepElement], sample_period: f64) -> Self {
        let step = |time: f64| (sample_period / (time.max(0.0) + sample_period)).max(1e-9);
        Self {
            elements: (elements.iter())
                .map(|e| (e.stiffness, step(e.time), 0.0))
                .collect(),
            last: None,
            missed: 0,
        }
    }

    /// A sample without a torsion.
    pub fn miss(&mut self) {
        self.missed = self.missed.saturating_add(1);
    }

    /// Moves to a torsion; gives the torque of all elements there, N·m.
    ///
    /// At the first torsion all are relaxed: the gear has carried it for long. Missed samples count as a steady
    /// move.
    pub fn update(&mut self, torsion: f64) -> f64 {
        if !torsion.is_finite() {
            self.miss();
            return self.torque();
        }
        let steps = f64::from(self.missed) + 1.0;
        let moved = (torsion - self.last.unwrap_or(torsion)) / steps;
        for (_, step, stretch) in &mut self.elements {
            // y' = (x - y)/T, tau = sum_j k_j (x - y_j), over equal steps of x.
            let kept = 1.0 - *step;
            let left = kept.powi(i32::from(self.missed) + 1);
            *stretch = left * *stretch + moved * kept * (1.0 - left) / *step;
        }
        self.last = Some(torsion);
        self.missed = 0;
        self.torque()
    }

    /// Torque of all elements, N·m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        (self.elements.iter())
            .map(|(stiffness, _, stretch)| stiffness * stretch)
            .sum()
    }

    /// Stiffness of all elements against a fast change, N·m/rad.
    #[must_use]
    pub fn stiffness(&self) -> f64 {
        self.elements.iter().map(|(stiffness, ..)| stiffness).sum()
    }

    /// The elements' stretches, rad.
    pub fn stretches(&self) -> impl Iterator<Item = f64> {
        self.elements.iter().map(|(.., stretch)| *stretch)
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        (self.last, self.missed) = (None, 0);
        self.elements.iter_mut().for_each(|e| e.2 = 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1e-3;

    fn creep() -> Creep {
        let element = |time, stiffness| CreepElement { time, stiffness };
        Creep::new(&[element(0.3, 100.0), element(2.0, 50.0)], PERIOD)
    }

    #[test]
    fn a_step_is_carried_at_once_and_given_up_in_the_relaxation_times() {
        let mut creep = creep();
        // A load that the gear has carried for long has relaxed.
        assert_eq!(creep.update(1e-3), 0.0);
        assert!((creep.update(2e-3) - 0.15).abs() < 1e-3);
        for step in 1..4000 {
            let t = PERIOD * f64::from(step);
            let expected = 0.1 * (-t / 0.3).exp() + 0.05 * (-t / 2.0).exp();
            let tau = creep.update(2e-3);
            assert!((tau - expected).abs() < 5e-4, "{t} {tau} {expected}");
        }
        assert_eq!(creep.stiffness(), 150.0);
        assert_eq!(creep.update(f64::NAN), creep.torque());
        creep.reset();
        assert_eq!(creep.torque(), 0.0);
    }

    #[test]
    fn samples_that_are_missed_on_a_steady_move_change_nothing() {
        let (mut whole, mut holed) = (creep(), creep());
        for step in 0..500 {
            let x = 1e-5 * f64::from(step);
            let reference = whole.update(x);
            match step {
                100..300 => holed.miss(),
                _ => assert!((holed.update(x) - reference).abs() < 1e-12),
            }
        }
    }

    #[test]
    fn it_takes_work_from_every_loop() {
        for frequency in [0.05, 0.5, 5.0] {
            let mut creep = creep();
            let (mut work, mut last) = (0.0, 0.0);
            for step in 0..40_000 {
                let phase = std::f64::consts::TAU * frequency * PERIOD * f64::from(step);
                let x = 1e-3 * phase.sin();
                let tau = creep.update(x);
                if step >= 20_000 {
                    work += tau * (x - last);
                }
                last = x;
            }
            assert!(work > 0.0, "{frequency} Hz: {work}");
        }
    }
}
