//! Legs of other proportions than those that the law's numbers were found on: none of them was looked at as they were.

mod common;

use common::{Bench, client_input, read};
use robot_state::Mode;

/// Factors of a robot's data sheet, which its simulation shares.
#[derive(Debug, Clone, Copy)]
struct Proportions {
    gear: f64,
    drive: f64,
    rotor: f64,
    friction: f64,
    /// Of K_s and K_d, where `torquectl check` asks for less.
    gains: f64,
}

const AS_IT_IS: Proportions = Proportions {
    gear: 1.0,
    drive: 1.0,
    rotor: 1.0,
    friction: 1.0,
    gains: 1.0,
};

impl Proportions {
    /// The configuration of such a robot.
    fn of(self, text: &str) -> String {
        let mut gear = 0.0;
        let scaled = |line: &str, key: &str, factor: f64| -> Option<String> {
            let rest = line.strip_prefix(key)?.trim_start().strip_prefix('=')?;
            let number: f64 = rest.split('#').next()?.trim().parse().ok()?;
            Some(format!("{key} = {}", number * factor))
        };
        let value = |line: &str| -> f64 {
            let number = line.split('=').nth(1).and_then(|it| it.split('#').next());
            number.and_then(|it| it.trim().parse().ok()).unwrap()
        };
        let lines = text.lines().map(|line| {
            if line.starts_with("K_fs0_Nm_per_rad") {
                gear = value(line);
            }
            if line.starts_with("K_tau_rad_per_Nm") {
                let drive = 1.0 / (value(line) - 1.0 / gear);
                let both = 1.0 / (self.drive * drive) + 1.0 / (self.gear * gear);
                return format!("K_tau_rad_per_Nm = {both}");
            }
            if let Some((before, gains)) = line.split_once("K_s_Nm_per_rad = ") {
                let (k_s, rest) = gains.split_once(", K_d_Nms_per_rad = ").unwrap();
                let (k_d, end) = rest.split_once(" }").unwrap();
                let [k_s, k_d] = [k_s, k_d].map(|it| it.parse::<f64>().unwrap() * self.gains);
                return format!("{before}K_s_Nm_per_rad = {k_s}, K_d_Nms_per_rad = {k_d} }}{end}");
            }
            let factors = [
                ("K_fs0_Nm_per_rad", self.gear),
                ("K_wg0_Nm_per_rad", self.gear),
                // The drive's own damping ratio stays.
                ("K_v_s", (self.rotor / self.drive).sqrt()),
                ("rotor_inertia_kg_m2", self.rotor),
                ("coulomb_Nm", self.friction),
            ];
            let mut found = factors.iter();
            found
                .find_map(|(key, factor)| scaled(line, key, *factor))
                .unwrap_or_else(|| line.to_owned())
        });
        lines.map(|line| line + "\n").collect()
    }
}

/// Follows a motion of all joints for two seconds, then stands.
fn moves_and_stands(proportions: Proportions, mode: Mode) {
    let mut bench = Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(match path.ends_with("robot.toml") {
            true => proportions.of(&text),
            false => text,
        })
    });
    bench.follow();
    let start = bench.reference(mode.number(), 0);
    let mut reference = start;
    reference.sequence = 1;
    let (mut swung, mut fastest) = (0.0_f64, 0.0_f64);
    for cycle in 0..4000 {
        reference.sequence += 1;
        let t = f64::from(cycle) * 1e-3;
        let moving = t < 2.0;
        let w = std::f64::consts::TAU;
        let amplitude = if moving { 0.04 } else { 0.0 };
        for (desired, from) in reference.joints.iter_mut().zip(&start.joints) {
            desired.q_d = from.q_d + amplitude * (1.0 - (w * t).cos());
            desired.dq_d = amplitude * w * (w * t).sin();
            desired.ddq_d = amplitude * w * w * (w * t).cos();
        }
        let record = bench.step(&client_input(&reference));
        assert_eq!(
            (record.fault, record.mode),
            (0, mode.number()),
            "{proportions:?} at {t} s"
        );
        let joints = &bench.plant.truth().joints;
        let now = joints
            .iter()
            .map(|joint| joint.dq.abs())
            .fold(0.0, f64::max);
        if moving {
            swung = swung.max(now);
        } else if t > 3.0 {
            fastest = fastest.max(now);
        }
    }
    assert!(swung > 0.1, "{proportions:?}: {swung} rad/s");
    assert!(fastest < 0.01, "{proportions:?}: {fastest} rad/s");
}

const OTHERS: [Proportions; 3] = [
    Proportions {
        gear: 0.4,
        friction: 2.0,
        gains: 0.4,
        ..AS_IT_IS
    },
    Proportions {
        gear: 3.0,
        rotor: 2.0,
        friction: 2.0,
        ..AS_IT_IS
    },
    Proportions {
        drive: 2.0,
        ..AS_IT_IS
    },
];

#[test]
fn legs_of_other_proportions_follow_inverse_dynamics_and_stand() {
    for proportions in OTHERS {
        moves_and_stands(proportions, Mode::InverseDynamics);
    }
}

#[test]
fn legs_of_other_proportions_follow_with_torque_feedback_and_stand() {
    for proportions in OTHERS {
        moves_and_stands(proportions, Mode::TorqueFeedbackMotion);
    }
}
