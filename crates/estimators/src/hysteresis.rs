//! Hysteresis of the gear: Coulomb-limited springs in parallel (Maxwell slip), independent of rate.
//!
//! Each element follows the torsion until its stretch reaches its limit, and slips from then on
//! (the stop operator). The torque is that of the elastic gear plus those of the elements, so it
//! follows from the torsion without solving for anything, and its stiffnesses follow from slow
//! loading loops by linear least squares. Beyond the papers: Z, G and U have no such state.

/// One spring that slips.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipElement {
    /// r: stretch at which it slips, rad, link side.
    pub limit: f64,
    /// k: its stiffness, N·m/rad.
    pub stiffness: f64,
}

/// Springs that slip, with their stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct Hysteresis {
    elements: Vec<(SlipElement, f64)>,
    /// Torsion of the last step, rad; none before the first.
    last: Option<f64>,
}

impl Hysteresis {
    /// Elements without stretch.
    #[must_use]
    pub fn new(elements: &[SlipElement]) -> Self {
        Self {
            elements: elements.iter().map(|e| (*e, 0.0)).collect(),
            last: None,
        }
    }

    /// Moves to a torsion; what all elements carry there, N·m.
    ///
    /// The first torsion counts as reached from zero, along the virgin curve.
    pub fn update(&mut self, torsion: f64) -> f64 {
        let moved = torsion - self.last.unwrap_or(0.0);
        if !moved.is_finite() {
            return self.torque();
        }
        self.last = Some(torsion);
        for (element, stretch) in &mut self.elements {
            *stretch = (*stretch + moved).clamp(-element.limit, element.limit);
        }
        self.torque()
    }

    /// What all elements carry, N·m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.elements
            .iter()
            .map(|(element, stretch)| element.stiffness * stretch)
            .sum()
    }

    /// The most that all elements together can carry, N·m.
    #[must_use]
    pub fn capacity(&self) -> f64 {
        self.elements
            .iter()
            .map(|(e, _)| (e.stiffness * e.limit).abs())
            .sum()
    }

    /// The elements' stretches, rad.
    pub fn stretches(&self) -> impl Iterator<Item = f64> {
        self.elements.iter().map(|(_, stretch)| *stretch)
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.last = None;
        self.elements
            .iter_mut()
            .for_each(|(_, stretch)| *stretch = 0.0);
    }
}
