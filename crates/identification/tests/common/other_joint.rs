//! Logs of joints of another make than the plant's, drawn at random: a gear with Dahl's hysteresis
//! and a cubic spring, a motor with Stribeck friction that slides late, encoders with errors of their
//! own, and a torque sensor behind a low-pass. Nothing here is shared with the fits or the inspection.

use identification::log::LogRow;
use joint_file::{JointFile, no_files};
use std::f64::consts::{PI, TAU};
use test_support::Random;

/// A joint, and how a log of it is made.
pub(crate) struct OtherJoint {
    /// N.
    pub(crate) ratio: f64,
    /// Rated torque, N·m.
    pub(crate) rated: f64,
    /// K_t of the data sheet, N·m/A.
    pub(crate) torque_constant: f64,
    /// Rotor inertia, kg·m².
    pub(crate) rotor: f64,
    /// Samples a second.
    pub(crate) rate: f64,
    counts: [f64; 2],
    stiffness: f64,
    stiffening: f64,
    dahl: [f64; 2],
    friction: Friction,
    gain: f64,
    /// Part by which the current grows faster than the torque at the rated one.
    saturating: f64,
    errors: Errors,
    sensor: Sensor,
    motion: Motion,
}

struct Friction {
    coulomb: f64,
    stiction: f64,
    stribeck: f64,
    viscous: f64,
    load: f64,
    way: f64,
}

struct Errors {
    /// Amplitude and phase at q, 2 q of the gear; theta, 2 theta of the gear, rad on the link side.
    gear: [[f64; 2]; 4],
    /// Of the encoders: link at q and 16 q, motor at theta, rad of each encoder.
    link: [[f64; 2]; 2],
    motor: [f64; 2],
    noise: f64,
    skew: f64,
    current: f64,
    ripple: [f64; 2],
    offset: f64,
}

struct Sensor {
    noise: f64,
    gain: f64,
    offset: f64,
    time: f64,
    step: f64,
}

struct Motion {
    /// Turning one way, rad/s.
    turning: f64,
    waves: Vec<[f64; 3]>,
    loads: Vec<[f64; 3]>,
    centre: f64,
    gravity: [f64; 2],
    inertia: f64,
    /// Time of a move and a rest; 0: it never rests.
    rest: f64,
    steps: f64,
}

fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.unit()
}

fn wave(random: &mut Random, most: f64) -> [f64; 2] {
    [most * (0.3 + 0.7 * random.unit()), TAU * random.unit()]
}

/// Sound logs unlike those that joints are drawn with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Form {
    /// A tenth of the speed.
    Slow,
    /// One way throughout, under a load that turns with the joint.
    OneWay,
    /// One way under a load of one sign, so that the current has one sign too.
    OneSign,
    /// Gravity alone, about the lowest place.
    Hanging,
    /// Hardly a load: friction is most of the current.
    Light,
    /// A gear of one stage with little friction.
    DirectDrive,
    /// Samples at 4 kHz.
    Fast,
    /// Fast motion at 250 Hz.
    Coarse,
    /// Friction of a third of the rated torque.
    Rough,
    /// Sensors and encoders with hardly any noise, as of a simulation.
    Quiet,
    /// A motor whose iron saturates: the torque constant falls by a third.
    Saturating,
    /// Standing most of the time.
    Standing,
}

impl Form {
    pub(crate) const ALL: [Self; 12] = [
        Self::Slow,
        Self::OneWay,
        Self::OneSign,
        Self::Hanging,
        Self::Light,
        Self::DirectDrive,
        Self::Fast,
        Self::Coarse,
        Self::Rough,
        Self::Quiet,
        Self::Saturating,
        Self::Standing,
    ];
}

impl OtherJoint {
    /// The joint in another form of log.
    pub(crate) fn in_form(mut self, form: Form, random: &mut Random) -> Self {
        let (rated, m) = (self.rated, &mut self.motion);
        let pace = |waves: &mut [[f64; 3]], by: f64| waves.iter_mut().for_each(|w| w[1] *= by);
        let size = |waves: &mut [[f64; 3]], by: f64| waves.iter_mut().for_each(|w| w[0] *= by);
        match form {
            Form::Slow => {
                pace(&mut m.waves, 0.1);
                pace(&mut m.loads, 0.1);
            }
            Form::OneWay | Form::OneSign => {
                m.turning = between(random, 0.1, 1.0);
                m.waves.clear();
                m.rest = 0.0;
                if form == Form::OneSign {
                    m.gravity[0] = 0.0;
                    // A load that winds up a rope: always against the motion.
                    m.loads.push([1.2 * rated, 0.0, 0.25 * TAU]);
                }
            }
            Form::Hanging => {
                m.gravity[1] = -m.centre;
                m.loads.clear();
                m.steps = 0.0;
            }
            Form::Light => {
                m.gravity[0] = 0.05 * rated;
                size(&mut m.loads, 0.1);
                m.steps = 0.0;
            }
            Form::DirectDrive => {
                let ratio = between(random, 6.0, 10.0);
                self.rotor *= (self.ratio / ratio).powi(2);
                self.torque_constant *= self.ratio / ratio;
                self.ratio = ratio;
                for part in [&mut self.friction.coulomb, &mut self.friction.stiction] {
                    *part *= 0.2;
                }
                self.friction.viscous *= 0.2;
                self.counts[0] = 2f64.powi(16 + random.below(4) as i32);
            }
            Form::Fast => self.rate = 4000.0,
            Form::Coarse => {
                self.rate = 250.0;
                pace(&mut m.waves, 2.5);
                pace(&mut m.loads, 2.5);
            }
            Form::Rough => {
                self.friction.coulomb = 0.3 * rated;
                self.friction.stiction = 0.4 * rated;
            }
            Form::Quiet => {
                self.counts = [2f64.powi(22); 2];
                self.sensor.noise = 1e-5 * rated;
                self.sensor.step = 1e-6 * rated;
                self.errors.current *= 0.01;
            }
            Form::Saturating => self.saturating = 0.5,
            Form::Standing => {
                m.turning = 0.0;
                size(&mut m.waves, 0.02);
            }
        }
        self
    }

    /// A joint by its seed.
    pub(crate) fn new(random: &mut Random) -> Self {
        let ratio = [50.0, 80.0, 100.0, 121.0, 160.0][random.below(5)];
        let rated = 10f64.powf(between(random, 0.8, 2.3));
        let current = between(random, 2.0, 12.0);
        let torque_constant = rated / (ratio * current);
        let swing = between(random, 0.01, 0.05);
        let stiffness = rated * between(random, 300.0, 900.0);
        let coulomb = rated * between(random, 0.03, 0.15);
        Self {
            ratio,
            rated,
            torque_constant,
            rotor: rated * swing / (ratio * ratio),
            rate: [250.0, 500.0, 1000.0][random.below(3)],
            counts: [
                2f64.powi(12 + random.below(6) as i32),
                2f64.powi(18 + random.below(5) as i32),
            ],
            stiffness,
            stiffening: between(random, 0.0, 0.5),
            dahl: [
                rated * between(random, 0.01, 0.05),
                between(random, 1e-5, 6e-5),
            ],
            friction: Friction {
                coulomb,
                stiction: coulomb * between(random, 1.0, 1.4),
                stribeck: between(random, 0.01, 0.05),
                viscous: rated * between(random, 0.01, 0.12),
                load: between(random, 0.0, 0.07),
                way: between(random, 1e-4, 5e-4),
            },
            gain: 1.0 + 0.08 * random.symmetric(),
            saturating: 0.0,
            errors: Errors {
                gear: [1.2e-4, 5e-5, 5e-5, 4e-5].map(|most| wave(random, most)),
                link: [3e-5, 1e-5].map(|most| wave(random, most)),
                motor: wave(random, 2e-3),
                noise: between(random, 0.2, 1.0),
                skew: 3e-4 * random.symmetric(),
                current: current * between(random, 0.003, 0.015),
                ripple: wave(random, 0.01 * rated),
                offset: 0.01 * current * random.symmetric(),
            },
            sensor: Sensor {
                noise: rated * between(random, 5e-4, 2e-3),
                gain: 1.0 + 0.005 * random.symmetric(),
                offset: 2e-3 * rated * random.symmetric(),
                time: between(random, 3e-4, 3e-3),
                step: rated * 3.0 / 32768.0,
            },
            motion: Motion::new(random, rated),
        }
    }

    /// The joint as its data sheet has it.
    pub(crate) fn file(&self) -> JointFile {
        let text = format!(
            "[joint]\nname = \"other\"\ngear_ratio = {}\ntorque_constant_Nm_per_A = {}\nrotor_inertia_kg_m2 = {}\n\
             rated_torque_Nm = {}\nlink_counts_per_turn = {}\nmotor_counts_per_turn = {}\nsample_rate_hz = {}\n",
            self.ratio,
            self.torque_constant,
            self.rotor,
            self.rated,
            self.counts[1],
            self.counts[0],
            self.rate
        );
        JointFile::parse(&text, "other.toml", &no_files).unwrap()
    }

    /// A log of some seconds.
    pub(crate) fn log(&self, seconds: f64, random: &mut Random) -> Vec<LogRow> {
        let step = 1.0 / self.rate;
        let mut state = State::default();
        let mut rows = Vec::new();
        let warm = (0.5 * self.rate) as usize;
        for k in 0..(seconds * self.rate) as usize + warm {
            let t = k as f64 * step;
            let [q, dq, ddq] = self.motion.at(t, step);
            let tau = self.motion.load(t, q, ddq);
            let row = self.row(&mut state, [t, q, dq, ddq, tau], random);
            if k >= warm {
                rows.push(LogRow {
                    t: t - warm as f64 * step,
                    ..row
                });
            }
        }
        rows
    }

    fn row(
        &self,
        state: &mut State,
        [t, q, dq, ddq, tau]: [f64; 5],
        random: &mut Random,
    ) -> LogRow {
        let e = &self.errors;
        let torsion = state.torsion(self, tau);
        let sine = |[size, phase]: [f64; 2], angle: f64| size * (angle + phase).sin();
        let theta = self.ratio * q;
        let error = sine(e.gear[0], q)
            + sine(e.gear[1], 2.0 * q)
            + sine(e.gear[2], theta)
            + sine(e.gear[3], 2.0 * theta);
        let motor = q + torsion + error;
        let friction = state.friction(&self.friction, motor, dq, tau);
        let inertia = self.rotor * self.ratio * self.ratio * ddq;
        let ripple = sine(e.ripple, 6.0 * theta);
        let torque = tau + friction + inertia + ripple;
        let iron = 1.0 + self.saturating * (torque / self.rated).powi(2).min(1.0);
        let exact = iron * torque / (self.ratio * self.torque_constant * self.gain);
        let sensed = state.sensed(&self.sensor, tau, 1.0 / self.rate);
        let grid = |x: f64, step: f64| (x / step).floor() * step;
        let mut encoder = |angle: f64, counts: f64| {
            grid(
                angle + e.noise * TAU / counts * random.normal(),
                TAU / counts,
            )
        };
        let link = encoder(
            q + sine(e.link[0], q) + sine(e.link[1], 16.0 * q),
            self.counts[1],
        );
        let shaft = self.ratio * (motor + e.skew * dq);
        let theta = encoder(shaft + sine(e.motor, shaft), self.counts[0]);
        LogRow {
            t,
            theta,
            q: link,
            current: grid(
                exact + e.offset + e.current * random.normal(),
                e.current / 3.0,
            ),
            tau_sensor: grid(
                self.sensor.gain * sensed
                    + self.sensor.offset
                    + self.sensor.noise * random.normal(),
                self.sensor.step,
            ),
            feed_forward: f64::NAN,
        }
    }
}

/// What a joint remembers from sample to sample.
#[derive(Default)]
struct State {
    torsion: f64,
    bristle: f64,
    motor: Option<f64>,
    slip: f64,
    sensed: f64,
}

impl State {
    /// The torsion at a torque, by bisection: K x (1 + s x²) + z, where Dahl's z follows x.
    fn torsion(&mut self, joint: &OtherJoint, tau: f64) -> f64 {
        let [most, way] = joint.dahl;
        let rated = joint.rated / joint.stiffness;
        let z = |x: f64| {
            let dx = x - self.torsion;
            let end = most * dx.signum();
            end + (self.bristle - end) * (-dx.abs() / way).exp()
        };
        let torque =
            |x: f64| joint.stiffness * x * (1.0 + joint.stiffening * (x / rated).powi(2)) + z(x);
        let (mut low, mut high) = (-20.0 * rated, 20.0 * rated);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if torque(middle) > tau {
                high = middle;
            } else {
                low = middle;
            }
        }
        let x = 0.5 * (low + high);
        self.bristle = z(x);
        self.torsion = x;
        x
    }

    /// Friction of the motor at its angle on the link side.
    fn friction(&mut self, of: &Friction, motor: f64, dq: f64, tau: f64) -> f64 {
        let moved = motor - self.motor.replace(motor).unwrap_or(motor);
        let stribeck = (of.stiction - of.coulomb) * (-(dq / of.stribeck).powi(2)).exp();
        let most = of.coulomb + stribeck + of.load * tau.abs();
        let end = most * moved.signum();
        self.slip = end + (self.slip - end) * (-moved.abs() / of.way).exp();
        self.slip + of.viscous * dq
    }

    fn sensed(&mut self, sensor: &Sensor, tau: f64, step: f64) -> f64 {
        self.sensed += (tau - self.sensed) * (1.0 - (-step / sensor.time).exp());
        self.sensed
    }
}

impl Motion {
    fn new(random: &mut Random, rated: f64) -> Self {
        let pace = between(random, 0.06, 0.25);
        let waves = (1..=3).map(|k| {
            let f = pace * f64::from(k * k) * between(random, 0.7, 1.3);
            [
                between(random, 0.3, 0.9) / f64::from(k * k),
                TAU * f,
                TAU * random.unit(),
            ]
        });
        let waves = waves.collect();
        let pace = between(random, 0.1, 0.3);
        let loads = (1..=3).map(|k| {
            let f = pace * f64::from(k * k) * between(random, 0.7, 1.3);
            [
                rated * between(random, 0.05, 0.3) / f64::from(k),
                TAU * f,
                TAU * random.unit(),
            ]
        });
        Self {
            turning: 0.0,
            waves,
            loads: loads.collect(),
            centre: 1.5 * random.symmetric(),
            gravity: [rated * between(random, 0.25, 0.7), PI * random.symmetric()],
            inertia: rated * between(random, 0.01, 0.06),
            rest: if random.below(3) == 0 {
                0.0
            } else {
                between(random, 2.0, 5.0)
            },
            steps: if random.below(3) == 0 {
                0.2 * rated
            } else {
                0.0
            },
        }
    }

    /// Time of the waves: it stands still in rests.
    fn pace(&self, t: f64) -> f64 {
        if self.rest == 0.0 {
            return t;
        }
        // Four parts motion, one part rest, with soft ends.
        let whole = 5.0 * self.rest;
        let (n, part) = ((t / whole).floor(), (t / whole).fract() * whole);
        let moving = 4.0 * self.rest;
        let soft = 0.5;
        let done = match part {
            p if p < soft => p * p / (2.0 * soft),
            p if p < moving - soft => p - 0.5 * soft,
            p if p < moving => moving - soft - (moving - p).powi(2) / (2.0 * soft),
            _ => moving - soft,
        };
        n * (moving - soft) + done
    }

    fn angle(&self, t: f64) -> f64 {
        let u = self.pace(t);
        let sum = self.waves.iter().map(|[a, w, p]| a * (w * u + p).sin());
        self.centre + self.turning * u + sum.sum::<f64>()
    }

    fn at(&self, t: f64, step: f64) -> [f64; 3] {
        let [a, b, c] = [t - step, t, t + step].map(|t| self.angle(t));
        [b, (c - a) / (2.0 * step), (a - 2.0 * b + c) / (step * step)]
    }

    fn load(&self, t: f64, q: f64, ddq: f64) -> f64 {
        let sum = self.loads.iter().map(|[a, w, p]| a * (w * t + p).sin());
        let stepped = if (t / 1.9).floor() % 3.0 == 1.0 {
            self.steps
        } else {
            0.0
        };
        self.gravity[0] * (q + self.gravity[1]).sin()
            + self.inertia * ddq
            + sum.sum::<f64>()
            + stepped
    }
}
