//! What actuators tell besides what the loop takes, for other threads.

use crate::family::Heard;
use core::sync::atomic::{AtomicU32, Ordering};
use std::sync::Arc;

/// What an actuator has told last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// What it has told at all.
    pub heard: Heard,
    /// Its error's number; 0: none.
    pub error: u32,
    /// Temperature, °C; none: not told.
    pub temperature: Option<f64>,
    /// Voltage of its supply, V; none: not told.
    pub voltage: Option<f64>,
}

/// The reports of a robot's actuators. Each number is whole; two of one actuator may be of different
/// frames.
#[derive(Clone, Debug)]
pub struct Reports(Arc<[[AtomicU32; 4]]>);

impl Reports {
    pub(super) fn new(actuators: usize) -> Self {
        let unknown = f32::NAN.to_bits();
        let made = (0..actuators).map(|_| [0, 0, unknown, unknown].map(AtomicU32::new));
        Self(made.collect())
    }

    pub(super) fn set(&self, index: usize, report: Report) {
        let Report {
            heard,
            error,
            temperature,
            voltage,
        } = report;
        let bits = |flag, bit: u32| u32::from(flag) << bit;
        let told = bits(heard.position, 0) | bits(heard.current, 1) | bits(heard.state, 2);
        let float = |x: Option<f64>| (x.unwrap_or(f64::NAN) as f32).to_bits();
        if let Some(numbers) = self.0.get(index) {
            let new = [told, error, float(temperature), float(voltage)];
            for (number, new) in numbers.iter().zip(new) {
                number.store(new, Ordering::Relaxed);
            }
        }
    }

    /// The report of the actuator of that number.
    #[must_use]
    pub fn get(&self, index: usize) -> Report {
        let Some(numbers) = self.0.get(index) else {
            return Report::default();
        };
        let [told, error, temperature, voltage] =
            [0, 1, 2, 3].map(|i: usize| numbers[i].load(Ordering::Relaxed));
        let float = |bits| Some(f64::from(f32::from_bits(bits))).filter(|x| x.is_finite());
        Report {
            heard: Heard {
                position: told & 1 != 0,
                current: told & 2 != 0,
                state: told & 4 != 0,
            },
            error,
            temperature: float(temperature),
            voltage: float(voltage),
        }
    }
}
