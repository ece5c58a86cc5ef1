//! The leg with encoders on its motors alone, beside the same leg with link-side encoders:
//! `cargo run --release -p cycle --example motor_alone | cargo run -p test-support --example results_page
//! docs/results/motor-alone.md`

#![allow(clippy::disallowed_macros, reason = "prints a page")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Bench, FLOOR, client_input, read, spoil_ft};
use control::margins::Load;
use robot_state::{Event, JointReference, Mode, Reference, torque_flags};
use std::f64::consts::TAU;
use std::io;

const ROBOT: &str = "hrp2-like";
const JOINTS: usize = 6;
const SEEDS: [u64; 5] = [1, 2, 3, 4, 5];
/// D Table 3, K6 = 0.5: greatest tracking error on the stairs, mrad; hip yaw is not in it.
const D_TABLE_3: [&str; JOINTS] = ["-", "2.95", "7.83", "41.55", "5.92", "3.69"];

/// Changes to a robot's files.
#[derive(Clone, Copy)]
struct Case {
    robot: &'static str,
    seed: u64,
    /// Configured over true stiffness of the gears.
    stiffness: f64,
    on_floor: bool,
    /// K_i as configured, or none.
    integral: bool,
}

impl Case {
    fn bench(self) -> Bench {
        Bench::reading(self.robot, &|path| self.text(path))
    }

    fn text(self, path: &str) -> io::Result<String> {
        let mut text = read(path)?;
        if path.ends_with("/sim.toml") {
            text = text.replace("seed = 1\n", &format!("seed = {}\n", self.seed));
            if self.on_floor {
                text += FLOOR;
            }
        }
        if path.ends_with("/robot.toml") {
            let key = "K_fs0_Nm_per_rad = ";
            let lines = text.lines().map(|line| match line.strip_prefix(key) {
                Some(k) => format!("{key}{}", self.stiffness * k.parse().unwrap_or(f64::NAN)),
                None => line.to_owned(),
            });
            text = lines.collect::<Vec<_>>().join("\n");
            if !self.integral {
                text = text.replace("gains = { ", "gains = { K_i_per_s = 0.0, ");
            }
        }
        Ok(text)
    }
}

const PLAIN: Case = Case {
    robot: ROBOT,
    seed: 1,
    stiffness: 1.0,
    on_floor: false,
    integral: true,
};

/// A sum of squares and the greatest.
#[derive(Clone, Copy, Default)]
struct Figure {
    squares: f64,
    count: f64,
    greatest: f64,
}

impl Figure {
    fn add(&mut self, x: f64) {
        self.squares += x * x;
        self.count += 1.0;
        self.greatest = self.greatest.max(x.abs());
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count.max(1.0)).sqrt()
    }
}

/// One joint's errors.
#[derive(Clone, Copy, Default)]
struct Errors {
    largest: f64,
    /// Torque from F/T sensors and IMU at its own instant, and that over its sigma.
    late: Figure,
    normed: Figure,
    /// tau_hat now.
    now: Figure,
    /// Measured angle, and the motor's over N, rad.
    angle: Figure,
    motor: Figure,
    /// Desired less true angle, rad.
    position: Figure,
    /// True less desired torque, N·m.
    control: Figure,
}

/// A swing of every joint, or torques of the knee with the foot on the floor. Returns the joints' errors, the
/// fault, and how often a torque was found implausible.
fn run(case: Case, frequency: f64, torques: bool) -> ([Errors; JOINTS], [u64; 2]) {
    let mut bench = case.bench();
    bench.run(600);
    let mode = if torques {
        Mode::Torque
    } else {
        Mode::InverseDynamics
    };
    let start = {
        let mut start = bench.reference(mode.number(), 1);
        start.contact_wrench_given = 0;
        let joints = &bench.cycle.record().estimated.joints;
        for (desired, joint) in start.joints.iter_mut().zip(joints) {
            desired.tau_d = joint.tau_whole_body.tau;
        }
        start
    };
    let mut reference = start;
    let mut errors = [Errors::default(); JOINTS];
    let (mut truth, mut fault): (Vec<Vec<f64>>, u32) = (Vec::new(), 0);
    for k in 0..4000_u32 {
        let t = f64::from(k) * 1e-3;
        reference.sequence += 1;
        if torques {
            let press = 6.35 * (1.0 - (TAU * frequency * t).cos());
            reference.joints[3].tau_d = start.joints[3].tau_d - press;
        } else {
            swing(&mut reference, &start, frequency, t)
        }
        let record = *bench.step(&client_input(&reference));
        fault = fault.max(record.fault);
        truth.push(bench.plant.truth().joints.iter().map(|j| j.tau).collect());
        if k < 1000 {
            continue;
        }
        let real = &bench.plant.truth().joints;
        for (j, e) in errors.iter_mut().enumerate() {
            let (estimated, measured) = (&record.estimated.joints[j], &record.measured.joints[j]);
            let late = estimated.tau_whole_body;
            let delay = (late.delay_s * 1e3).round() as usize;
            let error = late.tau - truth[k as usize - delay][j];
            e.largest = e.largest.max(real[j].tau.abs());
            e.late.add(error);
            e.normed.add(error / late.sigma.max(1e-12));
            if estimated.tau_hat.flags & torque_flags::VALID != 0 {
                e.now.add(estimated.tau_hat.tau - real[j].tau);
            }
            e.angle.add(measured.q - real[j].q);
            e.motor.add(measured.theta / 100.0 - real[j].q);
            e.position.add(reference.joints[j].q_d - real[j].q);
            e.control.add(real[j].tau - reference.joints[j].tau_d);
        }
    }
    let implausible = bench.cycle.record().events[Event::FtImplausible.index()];
    (errors, [u64::from(fault), implausible])
}

fn swing(reference: &mut Reference, start: &Reference, frequency: f64, t: f64) {
    let w = TAU * frequency;
    let (sin, cos) = (w * t).sin_cos();
    let amplitudes = [0.1, -0.1, -0.3, 0.4, -0.2, 0.1];
    let joints = reference.joints.iter_mut().zip(&start.joints);
    for ((joint, start), a) in joints.zip(amplitudes) {
        *joint = JointReference {
            q_d: start.q_d + 0.5 * a * (1.0 - cos),
            dq_d: 0.5 * a * w * sin,
            ddq_d: 0.5 * a * w * w * cos,
            ..JointReference::default()
        };
    }
}

/// Greatest way of a joint, degrees, and the fault, after an F/T sensor has fallen silent in a mode.
fn silent(case: Case, mode: Mode) -> (f64, u32) {
    let mut bench = case.bench();
    bench.run(600);
    let mut reference = bench.reference(mode.number(), 1);
    reference.contact_wrench_given = 0;
    let joints = &bench.cycle.record().estimated.joints;
    for (desired, joint) in reference.joints.iter_mut().zip(joints) {
        desired.tau_d = joint.tau_whole_body.tau;
    }
    let (mut from, mut way): (Vec<f64>, f64) = (Vec::new(), 0.0);
    for k in 0..2500 {
        bench.gather();
        if k >= 1000 {
            bench.drop_answers(|frame| matches!(frame.id, 0x181 | 0x182));
        }
        reference.sequence += 1;
        bench.compute(&client_input(&reference));
        let angles = bench.plant.truth().joints.iter().map(|j| j.q);
        if k <= 1000 {
            from = angles.collect();
        } else {
            let ways = angles.zip(&from).map(|(q, from)| (q - from).abs());
            way = ways.fold(way, f64::max);
        }
    }
    (way.to_degrees(), bench.cycle.record().fault)
}

/// A change of the F/T sensor's axes in the `k`-th cycle.
type Lie = fn(&mut [f64; 6], u32);

const LIES: [(&str, Lie); 7] = [
    ("reversed", |axes, _| axes.iter_mut().for_each(|x| *x = -*x)),
    ("axes exchanged", |axes, _| axes.rotate_left(1)),
    ("steps by 50 N and 5 N·m", |axes, _| {
        (axes[2], axes[4]) = (axes[2] + 50.0, axes[4] + 5.0);
    }),
    ("steps by 20 N·m", |axes, _| axes[4] += 20.0),
    ("steps by 200 N", |axes, _| axes[0] += 200.0),
    ("drifts by 20 N/s and 4 N·m/s", |axes, k| {
        let t = 1e-3 * f64::from(k);
        (axes[2], axes[4]) = (axes[2] + 20.0 * t, axes[4] + 4.0 * t);
    }),
    ("drifts by 60 N·m/s", |axes, k| {
        axes[4] -= 0.06 * f64::from(k)
    }),
];

/// Outcome of an F/T sensor that errs.
struct Lied {
    way: f64,
    speed: f64,
    /// Time until it was found, ms.
    found: Option<u32>,
    fault: u32,
}

fn lying(case: Case, lie: Lie) -> Lied {
    let mut bench = case.bench();
    bench.run(600);
    let mut reference = bench.reference(Mode::Torque.number(), 1);
    reference.contact_wrench_given = 0;
    let joints = &bench.cycle.record().estimated.joints;
    for (desired, joint) in reference.joints.iter_mut().zip(joints) {
        desired.tau_d = joint.tau_whole_body.tau;
    }
    let mut lied = Lied {
        way: 0.0,
        speed: 0.0,
        found: None,
        fault: 0,
    };
    let mut from = Vec::new();
    for k in 0..1350_u32 {
        bench.gather();
        if let Some(k) = k.checked_sub(350) {
            spoil_ft(&mut bench, |axes| lie(axes, k));
        } else {
            from = bench.plant.truth().joints.iter().map(|j| j.q).collect();
        }
        reference.sequence += 1;
        let record = *bench.compute(&client_input(&reference));
        let Some(k) = k.checked_sub(350) else {
            continue;
        };
        if record.events[Event::FtImplausible.index()] > 0 {
            lied.found.get_or_insert(k);
        }
        lied.fault = lied.fault.max(record.fault);
        let joints = bench.plant.truth().joints.iter().zip(&from);
        for ((joint, from), p) in joints.zip(&bench.robot.parameters.joints) {
            lied.way = lied.way.max((joint.q - from).abs());
            lied.speed = lied.speed.max(joint.dq.abs() / p.limits.velocity);
        }
    }
    lied
}

/// Margins of every joint's feedback, load by load.
fn margins(bench: &Bench) {
    println!(
        "\n## Margins\n\nPhase, degrees, and gain, dB, of each joint's loop opened at the motor's torque, as `torquectl margins` has them: the torque's loop with five loads, with K_s and K_d three.\n\n<!-- rows: motor-alone-margins.csv, 2 least of spring -->\n\n| joint | K_i, 1/s | blocked | stuck | free | light | spring | K_s: free | light | heavy |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    let parameters = &bench.robot.parameters;
    for joint in &parameters.joints {
        let Some(space) = robot_config::motor_side_loop(joint, parameters) else {
            continue;
        };
        let torque = space.of_torque();
        let cell = |of: &control::margins::MotorSideLoop, load: &Load| {
            let (degrees, db) = of.margins(*load).in_degrees_and_db();
            if db.is_finite() {
                format!(" {degrees:.0}, {db:.0} |")
            } else {
                format!(" {degrees:.0}, - |")
            }
        };
        let cells: String = (Load::ALL.iter().map(|load| cell(&torque, load)))
            .chain(Load::MOVING.iter().map(|load| cell(&space, load)))
            .collect();
        println!("| {} | {:.1} |{cells}", joint.name, space.gains.k_i);
    }
}

/// The worst of the seeds, by joint.
fn worst(
    case: Case,
    frequency: f64,
    torques: bool,
    faults: &mut Vec<[u64; 2]>,
) -> [Vec<Errors>; JOINTS] {
    let mut all: [Vec<Errors>; JOINTS] = std::array::from_fn(|_| Vec::new());
    for seed in SEEDS {
        let (errors, fault) = run(Case { seed, ..case }, frequency, torques);
        faults.push(fault);
        for (all, e) in all.iter_mut().zip(errors) {
            all.push(e);
        }
    }
    all
}

fn most(all: &[Errors], of: impl Fn(&Errors) -> f64) -> f64 {
    all.iter().map(of).fold(0.0, f64::max)
}

fn main() {
    let bench = PLAIN.bench();
    let joints = &bench.robot.parameters.joints;
    let names: Vec<&str> = joints.iter().map(|j| j.name.as_str()).collect();
    let mut faults = Vec::new();
    println!(
        "# The leg with encoders on its motors alone\n\nMade by `cargo run --release -p cycle --example motor_alone | cargo run -p test-support --example results_page docs/results/motor-alone.md`. The leg of `config/hrp2-like` hangs below a torso in a harness; `config/leg` is the same leg, bolted down, with link-side encoders. Every disturbance of `sim.toml` is on. Seeds {SEEDS:?} draw robots with other masses, sensors and gears; each figure is the **worst** of them.\n\nEvery joint swings by inverse dynamics with K6 = 0.5 (hip_pitch 0.3). Torque from F/T sensors and IMU against the truth at its own instant, and `tau_hat` against the truth now: RMS in per cent of the largest torque (normed: by its sigma). Angle: RMS error of `q`, and of the motor's angle over N, which is D's. Position: RMS and greatest error of the true angle. D: greatest error on HRP-2's stairs at K6 = 0.5 (Table 3), another motion on another robot.\n"
    );
    for frequency in [0.3, 1.4] {
        let alone = worst(PLAIN, frequency, false, &mut faults);
        let leg = Case {
            robot: "leg",
            ..PLAIN
        };
        let with_links = worst(leg, frequency, false, &mut faults);
        println!(
            "## Swings at {frequency} Hz\n\n<!-- rows: motor-alone-{frequency}-Hz.csv, 2 greatest of greatest, mrad -->\n\n| joint | largest, N·m | F/T + IMU, % | with link \
             encoders, % | normed | tau_hat, % | angle, mrad | theta/N, mrad | position, mrad | greatest, mrad | with \
             link encoders, mrad | D, mrad |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
        );
        for j in 0..JOINTS {
            let (a, b) = (&alone[j], &with_links[j]);
            println!(
                "| {} | {:.2} | {:.2} | {:.2} | {:.1} | {:.1} | {:.3} | {:.3} | {:.2} | {:.2} | {:.2} | {} |",
                names[j],
                most(a, |e| e.largest),
                most(a, |e| 100.0 * e.late.rms() / e.largest),
                most(b, |e| 100.0 * e.late.rms() / e.largest),
                most(a, |e| e.normed.rms()),
                most(a, |e| 100.0 * e.now.rms() / e.largest),
                most(a, |e| 1e3 * e.angle.rms()),
                most(a, |e| 1e3 * e.motor.rms()),
                most(a, |e| 1e3 * e.position.rms()),
                most(a, |e| 1e3 * e.position.greatest),
                most(b, |e| 1e3 * e.position.greatest),
                D_TABLE_3[j],
            );
        }
        println!();
    }
    println!(
        "## Gears softer or stiffer than configured\n\n1.4 Hz as above; the configuration's K_fs0 times a factor. Worst \
         joint and seed.\n\n| configured over true | F/T + IMU, % | angle, mrad | position, mrad | greatest, mrad |\n| --- | --- | \
         --- | --- | --- |"
    );
    for stiffness in [0.7, 1.0, 1.3] {
        let all = worst(Case { stiffness, ..PLAIN }, 1.4, false, &mut faults).concat();
        println!(
            "| {stiffness} | {:.2} | {:.3} | {:.2} | {:.2} |",
            most(&all, |e| 100.0 * e.late.rms() / e.largest),
            most(&all, |e| 1e3 * e.angle.rms()),
            most(&all, |e| 1e3 * e.position.rms()),
            most(&all, |e| 1e3 * e.position.greatest),
        );
    }
    println!(
        "\n## Torque control\n\nThe foot stands on the floor, and in mode torque the knee's torque presses it down by some \
         100 N more and less (D 5.4). True less desired torque, N·m: RMS (greatest).\n\n<!-- rows: motor-alone-torque.csv, 3 greatest of 0.4 Hz -->\n\n| joint | Coulomb friction, N·m | 0.4 Hz | \
         without feedback | K_fs0 times 0.7 | times 1.3 | 1 Hz |\n| --- | --- | --- | --- | --- | --- | --- |"
    );
    let floor = Case {
        on_floor: true,
        ..PLAIN
    };
    let cases = [
        (floor, 0.4),
        (
            Case {
                integral: false,
                ..floor
            },
            0.4,
        ),
        (
            Case {
                stiffness: 0.7,
                ..floor
            },
            0.4,
        ),
        (
            Case {
                stiffness: 1.3,
                ..floor
            },
            0.4,
        ),
        (floor, 1.0),
    ];
    let runs: Vec<_> = (cases.iter())
        .map(|(case, frequency)| worst(*case, *frequency, true, &mut faults))
        .collect();
    for (j, joint) in joints.iter().enumerate() {
        let friction = 100.0 * joint.estimator.wave_generator.friction;
        let cell = |run: &[Vec<Errors>; JOINTS]| {
            let (rms, greatest) = (
                most(&run[j], |e| e.control.rms()),
                most(&run[j], |e| e.control.greatest),
            );
            format!(" {rms:.2} ({greatest:.2}) |")
        };
        let cells: String = runs.iter().map(cell).collect();
        println!("| {} | {friction:.1} |{cells}", joint.name);
    }
    println!(
        "\n## F/T sensor silent\n\nGreatest way of any joint afterwards, worst seed.\n\n| mode | foot | way, degrees | fault |\n| --- | --- | --- | --- |"
    );
    for mode in [Mode::Torque, Mode::InverseDynamics] {
        for (on_floor, foot) in [(false, "hangs"), (true, "on the floor")] {
            let runs = SEEDS.map(|seed| {
                silent(
                    Case {
                        seed,
                        on_floor,
                        ..PLAIN
                    },
                    mode,
                )
            });
            let way = runs.iter().map(|r| r.0).fold(0.0, f64::max);
            let fault = runs.iter().map(|r| r.1).max().unwrap_or(0);
            println!("| {} | {foot} | {way:.3} | {fault} |", mode.name());
        }
    }
    println!(
        "\n## F/T sensor errs\n\nMode torque with the torques that the joints carry, after 0.35 s in it; the error \
         begins, and lasts for a second. Greatest way and speed of any joint, worst seed; 213: the event by which a \
         torque is found implausible by motor current, and not fed back any more, in how many of {} runs, and the \
         longest time until then. What 213 does not find moves no joint that stands either.\n\n\
         <!-- rows: motor-alone-errors.csv, 2 greatest of way, degrees -->\n\n| error | way, degrees | speed, % of the limit | 213 | after, ms | fault |\n| --- | --- | --- | --- | --- | --- |",
        SEEDS.len()
    );
    for (what, lie) in LIES {
        let runs = SEEDS.map(|seed| lying(Case { seed, ..PLAIN }, lie));
        let greatest = |of: fn(&Lied) -> f64| runs.iter().map(of).fold(0.0, f64::max);
        println!(
            "| {what} | {:.3} | {:.1} | {} | {:.0} | {} |",
            greatest(|r| r.way.to_degrees()),
            greatest(|r| 100.0 * r.speed),
            runs.iter().filter(|r| r.found.is_some()).count(),
            greatest(|r| f64::from(r.found.unwrap_or(0))),
            runs.iter().map(|r| r.fault).max().unwrap_or(0),
        );
    }
    let count = |of: fn(&[u64; 2]) -> bool| faults.iter().filter(|f| of(f)).count();
    println!(
        "\nOf the {} runs with sound sensors, {} latched a fault, and in {} a torque was found implausible.",
        faults.len(),
        count(|f| f[0] != 0),
        count(|f| f[1] != 0),
    );
    margins(&bench);
}
