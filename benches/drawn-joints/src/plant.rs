//! One joint: rotor, friction and drive behind a gear, a bearing and a link; its encoders, and the way of its commands.
//!
//! ```text
//! J m''   = motor + cogging - friction(m', T) - T (1 - dk/dm)      m: motor's angle over the ratio
//! J_l q'' = T (1 + dk/dq) - bearing(q') + M g l cos(q) + outside    T: gear(m - q - k), k: kinematic error
//! ```

use crate::drive::Drive;
use crate::friction::Friction;
use crate::gear::Gear;
use std::collections::VecDeque;
use test_support::Random;

/// Step of the simulation, s.
pub(crate) const DT: f64 = 25e-6;
/// Steps in a cycle of 1 ms.
pub(crate) const STEPS: usize = 40;

/// A sum of sines of an angle: amplitude, periods in a turn, phase.
pub(crate) type Waves = Vec<(f64, f64, f64)>;

pub(crate) fn waves(waves: &Waves, angle: f64) -> f64 {
    let one =
        |(amplitude, periods, phase): &(f64, f64, f64)| amplitude * (periods * angle + phase).sin();
    waves.iter().map(one).sum()
}

/// Derivative of the sum by the angle.
fn slope(waves: &Waves, angle: f64) -> f64 {
    let one = |(amplitude, periods, phase): &(f64, f64, f64)| {
        amplitude * periods * (periods * angle + phase).cos()
    };
    waves.iter().map(one).sum()
}

/// Outside of the link.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Outside {
    /// Held where it is.
    Blocked,
    /// Led at this velocity, rad/s, whatever the torque.
    Led(f64),
    /// Free but for a spring at an angle, of a stiffness and a damping; on one side only: a wall.
    Spring {
        at: f64,
        stiffness: f64,
        damping: f64,
        one_sided: bool,
    },
    /// Free.
    Free,
}

/// Sizes of the mechanism besides gear, friction and drive.
#[derive(Debug, Clone)]
pub(crate) struct Mechanism {
    pub(crate) ratio: f64,
    /// J: kg·m², link side.
    pub(crate) rotor: f64,
    /// J_l: kg·m².
    pub(crate) link: f64,
    /// Weight times its arm, N·m.
    pub(crate) weight: f64,
    /// Kinematic error, rad, by the link's and the motor's angle.
    pub(crate) kinematic: [Waves; 2],
    /// Cogging, N·m on the link side, by the motor's angle.
    pub(crate) cogging: Waves,
}

/// Errors of the sensors of angles and current.
#[derive(Debug, Clone)]
pub(crate) struct Sensors {
    /// Eccentricity of the link's and the motor's encoder, rad of their own turn.
    pub(crate) eccentric: [Waves; 2],
    /// Standard deviations: of the link's angle, of the motor's, rad of their own turn, of the current, A.
    pub(crate) noise: [f64; 3],
    /// Torque of the current, N·m/A on the link side, offset, A, and gain of its sensor.
    pub(crate) per_current: f64,
    pub(crate) offset: f64,
    pub(crate) gain: f64,
}

/// Way of a command, s: least time, and further time of which any is as likely.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transport {
    pub(crate) delay: f64,
    pub(crate) jitter: f64,
}

/// Samples of motor's and link's angle, rad, and current, A.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    pub(crate) theta: f64,
    pub(crate) q: f64,
    pub(crate) current: f64,
}

/// The joint.
#[derive(Debug, Clone)]
pub(crate) struct Joint {
    pub(crate) mechanism: Mechanism,
    pub(crate) sensors: Sensors,
    pub(crate) transport: Transport,
    pub(crate) gear: Gear,
    pub(crate) friction: Friction,
    pub(crate) bearing: Friction,
    pub(crate) drive: Drive,
    pub(crate) outside: Outside,
    pub(crate) random: Random,
    q: f64,
    dq: f64,
    motor: f64,
    omega: f64,
    torsion: f64,
    /// Torque on the link at the end of the last step, N·m.
    tau: f64,
    step: u64,
    on_the_way: VecDeque<(u64, f64)>,
}

impl Joint {
    /// At rest at `q`; a free link is carried against its weight.
    pub(crate) fn at_rest(
        (mechanism, sensors, transport): (Mechanism, Sensors, Transport),
        (gear, friction, bearing): (Gear, Friction, Friction),
        drive: crate::drive::Sizes,
        (q, outside): (f64, Outside),
        random: Random,
    ) -> Self {
        let load = match outside {
            Outside::Blocked | Outside::Led(_) => 0.0,
            Outside::Spring { .. } | Outside::Free => -mechanism.weight * q.cos(),
        };
        let torsion = gear.torsion_of(load);
        let mut joint = Self {
            drive: Drive::at_rest(drive, q + torsion, load),
            mechanism,
            sensors,
            transport,
            gear,
            friction,
            bearing,
            outside,
            random,
            q,
            dq: 0.0,
            motor: q + torsion,
            omega: 0.0,
            torsion,
            tau: load,
            step: 0,
            on_the_way: VecDeque::new(),
        };
        for _ in 0..20 {
            joint.motor = q + torsion + joint.kinematic_error();
        }
        joint.drive = Drive::at_rest(joint.drive.sizes.clone(), joint.motor, load);
        joint
    }

    fn kinematic_error(&self) -> f64 {
        let [of_link, of_motor] = &self.mechanism.kinematic;
        let theta = self.mechanism.ratio * self.motor;
        waves(of_link, self.q) + waves(of_motor, theta)
    }

    /// Angle and velocity of the link.
    pub(crate) fn link(&self) -> (f64, f64) {
        (self.q, self.dq)
    }

    /// Readings of the encoders and the current's sensor now, before counts.
    pub(crate) fn read(&mut self) -> Reading {
        let s = &self.sensors;
        let theta = self.mechanism.ratio * self.motor;
        let [link, motor, current] = s.noise.map(|sigma| sigma * self.random.normal());
        Reading {
            q: self.q + waves(&s.eccentric[0], self.q) + link,
            theta: theta + waves(&s.eccentric[1], theta) + motor,
            current: s.gain * self.drive.by_current() / s.per_current + s.offset + current,
        }
    }

    /// A set-point leaves now, rad.
    pub(crate) fn send(&mut self, set_point: f64) {
        let way = self.transport.delay + self.transport.jitter * self.random.unit();
        let due = self.step + (way / DT).round() as u64;
        let due = self.on_the_way.back().map_or(due, |last| due.max(last.0));
        self.on_the_way.push_back((due, set_point));
    }

    /// A cycle passes; the mean torque on the link in it, N·m.
    pub(crate) fn advance(&mut self) -> f64 {
        let sum: f64 = (0..STEPS).map(|_| self.advance_step()).sum();
        sum / STEPS as f64
    }

    fn advance_step(&mut self) -> f64 {
        while let Some(&(due, set_point)) = self.on_the_way.front() {
            if due > self.step {
                break;
            }
            self.drive.set_point = set_point;
            self.on_the_way.pop_front();
        }
        self.step += 1;
        let m = &self.mechanism;
        let theta = m.ratio * self.motor;
        // The drive sees its own encoder, eccentric as it is.
        let seen = self.motor + waves(&self.sensors.eccentric[1], theta) / m.ratio;
        let made = self.drive.advance(seen, theta, DT) + waves(&m.cogging, theta);
        let torsion = self.motor - self.q - self.kinematic_error();
        let rate = self.omega - self.dq;
        let gear = self.gear.advance(torsion, torsion - self.torsion, rate);
        self.torsion = torsion;
        let level = self.friction.level(self.omega, gear, [theta, self.q]);
        let friction = self.friction.advance(self.omega, level, DT);
        let [of_link, of_motor] = &self.mechanism.kinematic;
        let on_rotor = gear * (1.0 - self.mechanism.ratio * slope(of_motor, theta));
        let on_link = gear * (1.0 + slope(of_link, self.q));
        self.omega += DT / self.mechanism.rotor * (made - friction - on_rotor);
        self.motor += DT * self.omega;
        let level = self.bearing.level(self.dq, gear, [theta, self.q]);
        self.tau = on_link - self.bearing.advance(self.dq, level, DT);
        self.move_link();
        self.tau
    }

    fn move_link(&mut self) {
        let m = &self.mechanism;
        let outside = match self.outside {
            Outside::Blocked => return self.dq = 0.0,
            Outside::Led(velocity) => {
                self.dq = velocity;
                self.q += DT * velocity;
                return;
            }
            Outside::Free => 0.0,
            Outside::Spring {
                at,
                stiffness,
                damping,
                one_sided,
            } => {
                let push = stiffness * (at - self.q) - damping * self.dq;
                match one_sided {
                    true if self.q > at => push.min(0.0),
                    true => 0.0,
                    false => push,
                }
            }
        };
        let torque = self.tau + m.weight * self.q.cos() + outside;
        self.dq += DT / m.link * torque;
        self.q += DT * self.dq;
    }

    /// Energy in rotor, link, elastic gear and weight, J.
    #[cfg(test)]
    pub(crate) fn stored(&self) -> f64 {
        let m = &self.mechanism;
        let parts = 2000;
        let dx = self.torsion / f64::from(parts);
        let elastic = (0..parts).map(|k| dx * self.gear.elastic(dx * (f64::from(k) + 0.5)));
        0.5 * m.rotor * self.omega.powi(2) + 0.5 * m.link * self.dq.powi(2) + elastic.sum::<f64>()
            - m.weight * self.q.sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Catalogue;
    use crate::draw::Drawn;

    fn drawn(seed: u64) -> Drawn {
        let catalogue = Catalogue::all().unwrap();
        Drawn::new(&catalogue[seed as usize % catalogue.len()], seed)
    }

    /// A motor without current: what swings loses energy, and comes to rest where weight and friction are in balance.
    #[test]
    fn a_joint_without_current_loses_energy_until_it_rests() {
        for seed in 0..14 {
            let mut drawn = drawn(seed);
            (drawn.drive.limit, drawn.mechanism.cogging) = (0.0, Vec::new());
            let mut joint = drawn.at_rest(0.3, Outside::Free);
            joint.dq = 0.5;
            let first = joint.stored();
            // Slip elements give back what they have taken up: no more than their limits over their stiffness.
            let of_gear = drawn.gear.elements.iter();
            let of_gear: f64 = of_gear.map(|e| 0.5 * e.limit * e.limit / e.stiffness).sum();
            let most = drawn.friction.level(0.0, drawn.catalogue.limit, [0.0; 2]);
            let bearing = drawn.bearing.level(0.0, 0.0, [0.0; 2]);
            let lent = of_gear + drawn.friction.lent(1.3 * most) + drawn.bearing.lent(bearing);
            let mut last = first;
            for k in 0..10_000 {
                joint.advance();
                if k % 50 == 0 {
                    let now = joint.stored();
                    assert!(now <= last + lent + 1e-6 * first.abs(), "{}", drawn.name);
                    last = last.min(now);
                }
            }
            assert!(last < first, "{}", drawn.name);
            assert!(joint.dq.abs() < 1.0, "{}: {}", drawn.name, joint.dq);
        }
    }

    /// A drive whose set-point stands holds the link against its weight.
    #[test]
    fn at_rest_it_stays_and_reads_what_it_carries() {
        for seed in 0..21 {
            let drawn = drawn(seed);
            let mut joint = drawn.at_rest(0.3, Outside::Free);
            let torque = (0..2000).map(|_| joint.advance()).last().unwrap_or(0.0);
            let (q, dq) = joint.link();
            assert!(
                (q - 0.3).abs() < 5e-4 && dq.abs() < 2e-3,
                "{}: {q} {dq}",
                drawn.name
            );
            let weight = drawn.mechanism.weight * q.cos();
            let bearing = 2.0 * drawn.bearing.sizes.coulomb;
            assert!(
                (torque + weight).abs() < bearing,
                "{}: {torque} {weight}",
                drawn.name
            );
        }
    }

    /// Set-points act after the delay, within the jitter, and in their order.
    #[test]
    fn set_points_are_late_and_do_not_overtake_each_other() {
        let drawn = drawn(3);
        let mut joint = drawn.at_rest(0.3, Outside::Blocked);
        let rests = joint.drive.set_point;
        let Transport { delay, jitter } = drawn.transport;
        for k in 1..200 {
            joint.send(rests + 1e-9 * f64::from(k));
            let least = (delay / DT).floor() as usize;
            let most = ((delay + jitter) / DT).ceil() as usize + 1;
            let before = joint.drive.set_point;
            for step in 0..STEPS * 3 {
                joint.advance_step();
                if joint.drive.set_point > before {
                    assert!((least..=most).contains(&step), "{step} {least} {most}");
                    break;
                }
            }
            assert!(joint.drive.set_point > before);
            while !joint.on_the_way.is_empty() {
                joint.advance_step();
            }
        }
    }

    /// Every drawn drive settles on its own rotor: its maker would not ship one that rings.
    #[test]
    fn drives_settle_on_their_rotor_alone() {
        for seed in 0..49 {
            let drawn = drawn(seed);
            let step = 0.05 * drawn.catalogue.rated / drawn.drive.stiffness;
            let mut sizes = drawn.drive.clone();
            (sizes.dead_zone, sizes.ripple.0, sizes.count) = (0.0, 0.0, 1e-9);
            let mut drive = Drive::at_rest(sizes, 0.0, 0.0);
            drive.set_point = step;
            let (mut angle, mut omega, mut most) = (0.0, 0.0, 0.0_f64);
            for _ in 0..12_000 {
                omega += DT / drawn.mechanism.rotor * drive.advance(angle, 0.0, DT);
                angle += DT * omega;
                most = most.max(angle);
            }
            assert!(
                (angle / step - 1.0).abs() < 0.01,
                "{}: {}",
                drawn.name,
                angle / step
            );
            assert!(most / step < 1.5, "{}: {}", drawn.name, most / step);
        }
    }
}
