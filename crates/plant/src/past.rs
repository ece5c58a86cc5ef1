//! A delay line of a sensor's input over the last steps.

/// A sensor's input over the last steps, newest last.
#[derive(Debug, Clone)]
pub struct Past<const N: usize> {
    ring: Vec<[f64; N]>,
    newest: usize,
    started: bool,
}

impl<const N: usize> Past<N> {
    /// Room for `steps` steps before the newest.
    #[must_use]
    pub fn new(steps: usize) -> Self {
        Self {
            ring: vec![[0.0; N]; steps + 2],
            newest: 0,
            started: false,
        }
    }

    /// Appends the input at the end of a step; the first one holds for all steps before it too.
    pub fn push(&mut self, input: [f64; N]) {
        if !self.started {
            self.started = true;
            self.ring.fill(input);
        }
        self.newest = (self.newest + 1) % self.ring.len();
        self.ring[self.newest] = input;
    }

    /// Input that many steps before the newest, linearly interpolated between steps.
    #[must_use]
    pub fn ago(&self, steps: f64) -> [f64; N] {
        let len = self.ring.len();
        let steps = steps.clamp(0.0, (len - 2) as f64);
        let (whole, part) = (steps.floor() as usize, steps.fract());
        let at = |back: usize| &self.ring[(self.newest + len - back % len) % len];
        let (newer, older) = (at(whole), at(whole + 1));
        std::array::from_fn(|i| newer[i] * (1.0 - part) + older[i] * part)
    }
}
