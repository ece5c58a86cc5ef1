//! Differences from the shipped simulation: structures of drive that nothing was tuned on.

use plant::SimParameters;

/// A kind of drive and transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Variant {
    Shipped,
    /// Softer bristles, more stiction, wider Stribeck range, half as much friction again, load and speed
    /// counting more.
    OtherFriction,
    /// Half of the position gain.
    Softer,
    /// Twice the position gain.
    Stiffer,
    /// Commands act within the period: 0.3 ms.
    Early,
    /// Commands act after two periods.
    Late2,
    /// Commands act after three periods.
    Late3,
    /// Each command up to 0.6 ms later, 1 % lost.
    Jitter,
    /// The drive's loop at 1 kHz, its velocity filtered with 1 ms, current loop of 0.3 ms.
    SlowLoop,
    /// The drive's loop at 10 kHz without velocity filter.
    FastLoop,
    /// Three times the dead zone.
    WideZone,
    /// No dead zone.
    NoZone,
    /// The drive as shipped, moved as `torquectl identify drive` plans it: part after part.
    Plan,
}

impl Variant {
    pub(crate) const OTHERS: [Self; 12] = [
        Self::OtherFriction,
        Self::Softer,
        Self::Stiffer,
        Self::Early,
        Self::Late2,
        Self::Late3,
        Self::Jitter,
        Self::SlowLoop,
        Self::FastLoop,
        Self::WideZone,
        Self::NoZone,
        Self::Plan,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Shipped => "as shipped",
            Self::OtherFriction => "other friction",
            Self::Softer => "position gain × 0.5",
            Self::Stiffer => "position gain × 2",
            Self::Early => "delay 0.3 ms",
            Self::Late2 => "delay 2 ms",
            Self::Late3 => "delay 3 ms",
            Self::Jitter => "jitter 0.6 ms, 1 % lost",
            Self::SlowLoop => "drive's loop at 1 kHz",
            Self::FastLoop => "drive's loop at 10 kHz",
            Self::WideZone => "dead zone × 3",
            Self::NoZone => "no dead zone",
            Self::Plan => "as shipped, moved part after part",
        }
    }

    pub(crate) fn apply(self, sim: &mut SimParameters, period: f64) {
        match self {
            Self::Early => sim.transport.delay = Some(0.3e-3),
            Self::Late2 => sim.transport.delay = Some(2.0 * period),
            Self::Late3 => sim.transport.delay = Some(3.0 * period),
            Self::Jitter => (sim.transport.jitter, sim.transport.lost) = (0.6e-3, 0.01),
            _ => {}
        }
        for drive in sim.drives.values_mut() {
            let (friction, controller) = (&mut drive.friction, &mut drive.controller);
            match self {
                Self::OtherFriction => {
                    friction.coulomb *= 1.5;
                    friction.static_ratio = 1.6;
                    friction.stribeck = 6.0;
                    friction.presliding = 0.03;
                    friction.viscous *= 4.0;
                    friction.meshing = 0.1;
                }
                Self::Softer => controller.k_4 *= 0.5,
                Self::Stiffer => controller.k_4 *= 2.0,
                Self::SlowLoop => {
                    controller.rate = 1000.0;
                    controller.velocity_filter = 1e-3;
                    controller.current_loop = 0.3e-3;
                }
                Self::FastLoop => (controller.rate, controller.velocity_filter) = (10_000.0, 0.0),
                Self::WideZone => controller.dead_zone *= 3.0,
                Self::NoZone => controller.dead_zone = 0.0,
                _ => {}
            }
        }
    }
}
