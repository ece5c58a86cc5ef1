//! Values with their first two derivatives in time.

/// A value with its first two derivatives in time.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Jet(pub(super) f64, pub(super) f64, pub(super) f64);

impl Jet {
    pub(crate) fn times(self, o: Self) -> Self {
        Self(
            self.0 * o.0,
            self.1 * o.0 + self.0 * o.1,
            self.2 * o.0 + 2.0 * self.1 * o.1 + self.0 * o.2,
        )
    }

    pub(crate) fn scaled(self, k: f64) -> Self {
        Self(k * self.0, k * self.1, k * self.2)
    }

    pub(crate) fn sin(self) -> Self {
        let (s, c) = self.0.sin_cos();
        Self(s, c * self.1, c * self.2 - s * self.1 * self.1)
    }

    pub(crate) fn exp(self) -> Self {
        let e = self.0.exp();
        Self(e, e * self.1, e * (self.2 + self.1 * self.1))
    }
}

/// From 0 at `t = 0` to 1 at `t = duration`, at rest at both ends.
fn rise(t: f64, duration: f64) -> Jet {
    let s = (t / duration).clamp(0.0, 1.0);
    let k = 1.0 / duration;
    Jet(
        s * s * s * (10.0 + s * (6.0 * s - 15.0)),
        k * 30.0 * s * s * (1.0 - s) * (1.0 - s),
        k * k * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )
}

/// 1, with rise and fall within `fades` at both ends of `duration`.
pub(crate) fn window(t: f64, duration: f64, fades: (f64, f64)) -> Jet {
    let fall = rise(duration - t, fades.1);
    rise(t, fades.0).times(Jet(fall.0, -fall.1, fall.2))
}
