//! Inertial parameters and friction from torques that another route made: recovery, other motions,
//! every kind of joint, and logs that are refused.

#[path = "inertia/plant.rs"]
mod on_the_plant;
#[path = "inertia/refusals.rs"]
mod refusals;

use dynamics::{Base, Data, Inertia, Model, rnea, urdf_with_inertias};
use identification::inertia::judge::Model as Compared;
use identification::inertia::{Calibration, JointColumns, Robot, RobotLog, calibrate, consistent};
use problem::Problems;
use test_support::Random;

/// Revolute, prismatic and continuous joints, one that mimics another, parts held by fixed joints.
const URDF: &str = r#"<robot name="mixed">
  <link name="base"/>
  <link name="turret"><inertial><origin xyz="0.02 0 0.1"/><mass value="6"/><inertia ixx="0.06" iyy="0.05" izz="0.03"/></inertial></link>
  <link name="boom"><inertial><origin xyz="0.2 0.01 0"/><mass value="4"/><inertia ixx="0.01" iyy="0.09" izz="0.08"/></inertial></link>
  <link name="slide"><inertial><origin xyz="0.1 0 0.02"/><mass value="2"/><inertia ixx="0.005" iyy="0.02" izz="0.02"/></inertial></link>
  <link name="wrist"><inertial><origin xyz="0.02 0.03 0"/><mass value="1"/><inertia ixx="0.002" iyy="0.002" izz="0.003"/></inertial></link>
  <link name="tool"><inertial><origin xyz="0 0 0.05"/><mass value="0.5"/><inertia ixx="0.001" iyy="0.001" izz="0.0005"/></inertial></link>
  <link name="finger"><inertial><origin xyz="0 0.05 0"/><mass value="0.3"/><inertia ixx="0.0004" iyy="0.0002" izz="0.0004"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="turret"/><origin xyz="0 0 0.2" rpy="0.2 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="200" velocity="4"/></joint>
  <joint name="lift" type="revolute"><parent link="turret"/><child link="boom"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="200" velocity="4"/></joint>
  <joint name="extend" type="prismatic"><parent link="boom"/><child link="slide"/><origin xyz="0.4 0 0"/><axis xyz="1 0 0"/><limit lower="-0.3" upper="0.3" effort="300" velocity="1"/></joint>
  <joint name="roll" type="continuous"><parent link="slide"/><child link="wrist"/><origin xyz="0.25 0 0"/><axis xyz="1 0 0"/></joint>
  <joint name="held" type="fixed"><parent link="wrist"/><child link="tool"/><origin xyz="0.1 0 0" rpy="0 1 0"/></joint>
  <joint name="grip" type="revolute"><parent link="tool"/><child link="finger"/><origin xyz="0 0.02 0.1"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="20" velocity="9"/><mimic joint="roll" multiplier="0.3"/></joint>
</robot>"#;

fn model(text: &str) -> Model {
    Model::from_urdf(text, "mixed.urdf", Base::Fixed).unwrap()
}

/// The same robot with other inertias: up to a third more or less, centres moved by 3 cm, and a
/// payload on the tool.
fn other(seed: u64) -> String {
    let mut random = Random::new(seed);
    let mut uniform = |size: f64| size * (2.0 * random.unit() - 1.0);
    let names = ["turret", "boom", "slide", "wrist", "tool", "finger"];
    let frames: Vec<_> = model(URDF).frames().to_vec();
    let all = names.map(|name| {
        let own = frames.iter().find(|f| f.name == name).unwrap().inertia;
        let payload = if name == "tool" { 1.5 } else { 0.0 };
        let centre = own.center().map(|x| x + uniform(0.03));
        let mass = (own.mass + payload) * (1.0 + uniform(0.33));
        (
            name.to_owned(),
            Inertia::from_central(mass, centre, own.central() * (1.0 + uniform(0.33))),
        )
    });
    urdf_with_inertias(URDF, "mixed.urdf", &all).unwrap()
}

/// LuGre's friction, which no term of the fit is: bristles, Stribeck's dip, viscous friction.
#[derive(Clone)]
struct LuGre {
    coulomb: f64,
    viscous: f64,
    bristle: f64,
}

impl LuGre {
    fn torque(&mut self, v: f64, dt: f64) -> f64 {
        let stiffness = 400.0 * self.coulomb;
        let bound = self.coulomb * (1.0 + 0.4 * (-(v / 0.08).powi(2)).exp());
        // Exact for a velocity held over the step.
        let rate = stiffness * v.abs() / bound;
        let end = bound / stiffness * v.signum();
        self.bristle = end + (self.bristle - end) * (-rate * dt).exp();
        stiffness * self.bristle + self.viscous * v
    }
}

/// A log of a robot that follows a sum of sines: `pace` scales its frequencies.
struct Recorded {
    seconds: f64,
    rate: f64,
    pace: f64,
    noise: f64,
    seed: u64,
}

const RECORDED: Recorded = Recorded {
    seconds: 60.0,
    rate: 200.0,
    pace: 1.0,
    noise: 0.01,
    seed: 1,
};

impl Recorded {
    fn log(&self, text: &str) -> RobotLog {
        let model = model(text);
        let (n, mut data) = (model.joint_count(), Data::new(&model));
        let mut random = Random::new(self.seed);
        let sizes = [0.9, 0.7, 0.1, 1.5];
        let waves: Vec<[(f64, f64, f64); 4]> = (0..n)
            .map(|j| {
                [1.0, 2.0, 3.0, 5.0].map(|k: f64| {
                    let f = self.pace * 0.11 * k * (1.0 + 0.1 * random.unit());
                    (
                        sizes[j] / k.sqrt() * (0.4 + 0.6 * random.unit()),
                        std::f64::consts::TAU * f,
                        std::f64::consts::TAU * random.unit(),
                    )
                })
            })
            .collect();
        let mut friction: Vec<LuGre> = [(4.0, 6.0), (5.0, 8.0), (12.0, 40.0), (0.8, 0.5)]
            .map(|(coulomb, viscous)| LuGre {
                coulomb,
                viscous,
                bristle: 0.0,
            })
            .to_vec();
        let mut log = RobotLog {
            name: "run.csv".into(),
            t: Vec::new(),
            joints: vec![Some(JointColumns::default()); n],
        };
        // The friction's state needs steps shorter than the log's.
        let (substeps, mut largest) = (5, vec![0.0f64; n]);
        for k in 0..(self.seconds * self.rate) as usize * substeps {
            let t = k as f64 / (self.rate * substeps as f64);
            let sum = |j: usize, d: i32| {
                waves[j]
                    .iter()
                    .map(|(a, w, p)| {
                        a * w.powi(d)
                            * (w * t + p + f64::from(d) * std::f64::consts::FRAC_PI_2).sin()
                    })
                    .sum::<f64>()
            };
            let state: [Vec<f64>; 3] = [0, 1, 2].map(|d| (0..n).map(|j| sum(j, d)).collect());
            let slip: Vec<f64> = friction
                .iter_mut()
                .zip(&state[1])
                .map(|(f, v)| f.torque(*v, 1.0 / (self.rate * substeps as f64)))
                .collect();
            if k % substeps != 0 {
                continue;
            }
            let tau = rnea(&model, &mut data, &state[0], &state[1], &state[2], None).to_vec();
            log.t.push(t);
            for (j, columns) in log.joints.iter_mut().flatten().enumerate() {
                columns.q.push(state[0][j]);
                columns.tau.push(tau[j] + slip[j] + 0.3);
                largest[j] = largest[j].max(tau[j].abs());
            }
        }
        for (j, columns) in log.joints.iter_mut().flatten().enumerate() {
            columns
                .q
                .iter_mut()
                .for_each(|q| *q += 2e-5 * random.normal());
            columns
                .tau
                .iter_mut()
                .for_each(|tau| *tau += self.noise * largest[j] * random.normal());
        }
        log
    }
}

fn found(logs: &[RobotLog], others: &[RobotLog]) -> Result<Calibration, Problems> {
    let model = model(URDF);
    let all: Vec<usize> = (0..model.joint_count()).collect();
    calibrate(&Robot::new(&model, &all), logs, others, |_, _| {})
}

/// On three other robots of the same URDF: torques of held-out quarters and of another, faster
/// motion; the URDF that is written predicts as the robot does.
#[test]
fn another_robots_inertias_are_found_under_lugre_friction() {
    for seed in 1..=3 {
        let truth = other(seed);
        let log = Recorded { seed, ..RECORDED }.log(&truth);
        let faster = Recorded {
            seed: 100 + seed,
            pace: 1.4,
            seconds: 20.0,
            ..RECORDED
        }
        .log(&truth);
        let found = found(&[log], &[faster]).unwrap();
        assert!(!found.urdf_kept && !found.guessed_prior);
        for (k, (here, there)) in found.judged.iter().zip(&found.judged_on_others).enumerate() {
            let [urdf, identified] =
                [Compared::Urdf, Compared::Identified].map(|m| here.residual(m));
            assert!(
                identified < 0.5 * urdf,
                "seed {seed}, joint {k}: {identified} {urdf}"
            );
            assert!(
                identified < 0.02 * here.largest(),
                "seed {seed}, joint {k}: {identified} of {}",
                here.largest()
            );
            let other = there.residual(Compared::Identified);
            assert!(
                other < 0.02 * there.largest(),
                "seed {seed}, joint {k}: {other} of {}",
                there.largest()
            );
            assert!(
                (0.6..1.6).contains(&here.sigma_check()),
                "seed {seed}, joint {k}: {}",
                here.sigma_check()
            );
        }
        rigid_torques_agree(&truth, &found, seed);
    }
}

/// Without friction: the corrected URDF against the true robot in motion.
fn rigid_torques_agree(truth: &str, found: &Calibration, seed: u64) {
    let (before, truth) = (model(URDF), model(truth));
    let all: Vec<usize> = (0..before.joint_count()).collect();
    let links = consistent::of_links(&Robot::new(&before, &all), &found.inertias);
    let corrected = model(&urdf_with_inertias(URDF, "mixed.urdf", &links).unwrap());
    assert!(
        corrected
            .warnings()
            .iter()
            .all(|w| !w.reason.contains("principal moments"))
    );
    let mut random = Random::new(seed);
    let mut data = [&truth, &corrected].map(Data::new);
    let (mut square, mut whole) = ([0.0; 4], [0.0; 4]);
    for _ in 0..300 {
        let mut state = |size: [f64; 4]| size.map(|s| s * (2.0 * random.unit() - 1.0));
        let (q, v, a) = (
            state([1.5, 1.0, 0.2, 3.0]),
            state([1.0, 1.0, 0.2, 2.0]),
            state([3.0, 3.0, 0.7, 6.0]),
        );
        let [right, ours] =
            [0, 1].map(|k| rnea([&truth, &corrected][k], &mut data[k], &q, &v, &a, None).to_vec());
        for j in 0..4 {
            square[j] += (right[j] - ours[j]).powi(2);
            whole[j] += right[j].powi(2);
        }
    }
    for j in 0..4 {
        let share = (square[j] / whole[j]).sqrt();
        assert!(share < 0.05, "seed {seed}, joint {j}: {share}");
    }
}

/// The same motion recorded badly: stamps that shake, doubles, gaps, and coarse stamps.
#[test]
fn stamps_may_be_bad() {
    let good = Recorded {
        seconds: 40.0,
        ..RECORDED
    }
    .log(&other(5));
    let mut random = Random::new(3);
    let mut bad = RobotLog {
        t: Vec::new(),
        joints: vec![Some(JointColumns::default()); 4],
        name: good.name.clone(),
    };
    for (k, t) in good.t.iter().enumerate() {
        if (2000..2300).contains(&k) || k % 97 == 5 {
            continue;
        }
        for _ in 0..1 + usize::from(k % 50 == 7) {
            // To whole milliseconds: two in one of them have the same stamp.
            bad.t.push((1e3 * t + 0.4 * random.unit()).round() / 1e3);
            for (to, from) in bad
                .joints
                .iter_mut()
                .flatten()
                .zip(good.joints.iter().flatten())
            {
                to.q.push(from.q[k]);
                to.tau.push(from.tau[k]);
            }
        }
    }
    let [well, badly] = [good, bad].map(|log| found(&[log], &[]).unwrap());
    for (a, b) in well.judged.iter().zip(&badly.judged) {
        let [a, b] = [a, b].map(|j| j.residual(Compared::Identified));
        assert!(b < 1.25 * a, "{a} {b}");
    }
    for part in ["doubled rows left out", "1 gaps, the longest 1.5"] {
        assert!(
            badly.notes.iter().any(|note| note.contains(part)),
            "{part}: {:?}",
            badly.notes
        );
    }
}

/// A URDF that is right already is not made worse, and one without inertias is enough.
#[test]
fn a_right_urdf_stays_and_one_without_masses_is_enough() {
    let log = Recorded {
        noise: 0.05,
        seconds: 12.0,
        ..RECORDED
    }
    .log(URDF);
    let right = found(std::slice::from_ref(&log), &[]).unwrap();
    for judged in &right.judged {
        let [urdf, identified] = [Compared::Urdf, Compared::Identified].map(|m| judged.residual(m));
        assert!(identified < 1.03 * urdf, "{identified} {urdf}");
        assert!(identified < judged.residual(Compared::Plain));
    }
    let empty = URDF.split("<inertial>").map(|part| {
        part.split_once("</inertial>")
            .map_or(part, |(_, rest)| rest)
    });
    let empty = model(&empty.collect::<String>());
    let log = RECORDED.log(&other(9));
    let found = calibrate(&Robot::new(&empty, &[0, 1, 2, 3]), &[log], &[], |_, _| {}).unwrap();
    assert!(found.guessed_prior);
    for judged in &found.judged {
        let [base, identified] = [Compared::Base, Compared::Identified].map(|m| judged.residual(m));
        let largest = judged.largest();
        assert!(
            identified < 1.05 * base && identified < 0.03 * largest,
            "{identified} {base} of {largest}"
        );
    }
}

/// Base parameters: their number is known for simple robots, and most intervals hold the truth.
#[test]
fn base_parameters_are_those_of_the_structure() {
    let truth = other(4);
    let found = found(&[RECORDED.log(&truth)], &[]).unwrap();
    let model = model(&truth);
    let true_values = {
        let tens = model.bodies()[1..].iter().flat_map(|b| {
            consistent::ten(&b.inertia)
                .iter()
                .copied()
                .collect::<Vec<_>>()
        });
        found
            .base
            .values(&nalgebra::DVector::from_iterator(50, tens))
    };
    let inside = found
        .base_parameters
        .iter()
        .zip(&true_values)
        .filter(|(p, truth)| (p.value - **truth).abs() < 1.5 * p.half_interval);
    let (inside, all) = (inside.count(), found.base_parameters.len());
    assert!(10 * inside >= 7 * all, "{inside} of {all}");
    assert!(found.condition.is_finite() && found.condition > 1.0);
    // One link on a vertical axis: its moment of inertia alone is felt.
    let one = r#"<robot name="one"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
        <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"#;
    let one = Model::from_urdf(one, "one.urdf", Base::Fixed).unwrap();
    let base = identification::inertia::base::Base::new(&Robot::new(&one, &[0]));
    assert_eq!(base.independent, [9]);
    // The same axis lying: two components of the first moment as well.
    let mut tilted = one.clone();
    tilted.set_gravity([9.81, 0.0, 0.0].into());
    let base = identification::inertia::base::Base::new(&Robot::new(&tilted, &[0]));
    assert_eq!(base.independent, [9, 1, 2]);
}
