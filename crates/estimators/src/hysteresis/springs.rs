//! Springs that slip: rate-independent hysteresis, and what is not known of its past.

/// One spring that slips.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipElement {
    /// r: stretch at which it slips, rad, link side.
    pub limit: f64,
    /// k: its stiffness, N·m/rad.
    pub stiffness: f64,
}

/// Springs that slip, with their stretch.
///
/// Before the first torsion the springs may have any stretch up to their limit. The states from both limits
/// bound the true one, and meet once the torsion has moved over twice the limit one way: from then on the
/// past no longer counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Hysteresis {
    springs: Vec<Spring>,
    /// Torsion of the last step, rad; none before the first.
    last: Option<f64>,
}

/// A spring's stretch, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spring {
    element: SlipElement,
    /// From none at the first torsion.
    stretch: f64,
    /// From either limit.
    bounds: [f64; 2],
    /// Standard deviation as far as the torque has shown the past, rad: no motion makes it larger, as two springs
    /// that move together never move apart.
    shown: f64,
}

impl Spring {
    fn new(element: SlipElement) -> Self {
        Self {
            element,
            stretch: 0.0,
            bounds: [-element.limit, element.limit],
            shown: f64::INFINITY,
        }
    }

    /// Standard deviation of the stretch, rad: anywhere between the bounds, or as the torque has shown it.
    fn unknown(&self) -> f64 {
        let [middle, half] = self.interval();
        let off = middle - self.stretch;
        (half * half / 3.0 + off * off).sqrt().min(self.shown)
    }

    fn advance(&mut self, moved: f64) {
        let limit = self.element.limit;
        //= H Stop: s_j = min(max(s_j + x - x_last, -r_j), r_j)
        // max and min, not clamp: they cannot panic.
        let step = |stretch: f64| (stretch + moved).max(-limit).min(limit);
        self.bounds = self.bounds.map(step);
        self.stretch = step(self.stretch);
    }

    /// Middle of the bounds, and half their distance, rad.
    fn interval(&self) -> [f64; 2] {
        let [least, most] = self.bounds;
        [0.5 * (least + most), 0.5 * (most - least)]
    }
}

impl Hysteresis {
    /// Elements without stretch.
    #[must_use]
    pub fn new(elements: &[SlipElement]) -> Self {
        Self {
            springs: elements.iter().copied().map(Spring::new).collect(),
            last: None,
        }
    }

    /// Moves to a torsion; gives the torque of all elements there, N·m.
    ///
    /// At the first torsion every spring is without stretch, the middle of what it may have.
    pub fn update(&mut self, torsion: f64) -> f64 {
        let moved = torsion - self.last.unwrap_or(torsion);
        if !moved.is_finite() {
            return self.torque();
        }
        self.last = Some(torsion);
        for spring in &mut self.springs {
            spring.advance(moved);
        }
        self.torque()
    }

    /// Torque of all elements, N·m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        //= H Prandtl-Ishlinskii: tau = sum_j k_j s_j
        let springs = self.springs.iter();
        springs.map(|s| s.element.stiffness * s.stretch).sum()
    }

    /// Standard deviation of the torque by what was before the first torsion, N·m: each stretch is anywhere
    /// between its bounds, and all are off the same way, as one past made them.
    #[must_use]
    pub fn unknown(&self) -> f64 {
        let springs = self.springs.iter();
        springs
            .map(|spring| spring.element.stiffness.abs() * spring.unknown())
            .sum()
    }

    /// The torque has been shown to be larger by `error`, N·m, which leaves the share `left` of the variance of what is
    /// unknown: each stretch takes its part of it, within its bounds. Gives the change of the torque, N·m.
    pub fn learn(&mut self, error: f64, left: f64) -> f64 {
        let all = self.unknown();
        if !(error.is_finite() && (0.0..=1.0).contains(&left) && all > f64::MIN_POSITIVE) {
            return 0.0;
        }
        let before = self.torque();
        for spring in &mut self.springs {
            let unknown = spring.unknown();
            let [least, most] = spring.bounds;
            let moved = error * unknown / all * spring.element.stiffness.signum();
            // max and min, not clamp: they cannot panic.
            spring.stretch = (spring.stretch + moved).max(least).min(most);
            spring.shown = unknown * left.sqrt();
        }
        self.torque() - before
    }

    /// Largest torque of all elements together, N·m.
    #[must_use]
    pub fn capacity(&self) -> f64 {
        let springs = self.springs.iter();
        springs
            .map(|s| (s.element.stiffness * s.element.limit).abs())
            .sum()
    }

    /// Stiffness of the elements that have not slipped, N·m/rad.
    #[must_use]
    pub fn stiffness(&self) -> f64 {
        let holding = |s: &&Spring| s.stretch.abs() < s.element.limit;
        let springs = self.springs.iter().filter(holding);
        springs.map(|s| s.element.stiffness).sum()
    }

    /// The elements' stretches, rad.
    pub fn stretches(&self) -> impl Iterator<Item = f64> {
        self.springs.iter().map(|s| s.stretch)
    }

    /// Of each element the middle of the stretches that it may have, and half their range, rad.
    pub fn intervals(&self) -> impl Iterator<Item = [f64; 2]> {
        self.springs.iter().map(Spring::interval)
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.last = None;
        (self.springs.iter_mut()).for_each(|spring| *spring = Spring::new(spring.element));
    }
}
