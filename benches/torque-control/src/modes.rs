//! Experiments of Z and G on every joint: passive mode (Z IV-C), motion with torque feedback (Z IV-B),
//! tracking by low gains with a learned feed-forward (G V-B).

use crate::cases::{Case, PREDICTIVE, SEEDS, WRONG, cases, parallel};
use crate::joint::{Bench, DT, JOINTS, START, Seen, Wish, unpowered};
use crate::robots::{Driven, rms};
use crate::variant::{Conditions, shipped};
use control::{CarriedTorque, largest_follow};
use dynamics::GRAVITY;
use estimators::features::MAX_FEATURES;
use estimators::local_gp::{LocalGp, LocalGpParameters};
use identification::gaussian_process::{GatherMotion, MotionLog, motion_options, train_motion};
use identification::record::smooth;
use plant::RigLoad;
use robot_config::{JointParameters, Robot};
use robot_state::{Mode, Reference};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;
use test_support::ResultsPage;

/// Swing of a hand: largest velocities, rad/s, and frequencies, Hz.
pub(crate) const HANDS: [(f64, f64); 3] = [(0.25, 0.1), (0.5, 0.1), (0.5, 0.25)];
/// Share of K_d that damps a joint in passive mode, as the configurations have it by default.
const PASSIVE_DAMPING: f64 = 0.005;
/// Shares of K_s and K_d for tracking by low gains, as the configurations have them by default.
const LOW: [f64; 2] = [0.05, 0.2];
/// Weight of the load that the joint swings, at a right angle, share of rated torque.
const WEIGHT: f64 = 0.3;
/// Time after the start that is not judged, s, and the end of a run.
const SETTLED_S: f64 = 2.0;
const END_S: f64 = 26.0;

/// Root mean square of the torque that moves the joint, % of rated: motor without current; desired torque
/// of zero without feedback of the torque; passive mode. For each of [`HANDS`].
pub(crate) type Passive = [[f64; 3]; HANDS.len()];

/// Root mean square of the tracking error, degrees.
pub(crate) struct Tracked {
    /// By the drive's own position loop.
    pub(crate) drive: f64,
    /// By K_s and K_d without torque feedback, and with it.
    pub(crate) feedback: [f64; 2],
    /// By low gains: nothing fed forward, the learned torque.
    pub(crate) learned: [f64; 2],
}

/// A hand swings the link; the torque that it feels is the gear's.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn passive(index: usize, conditions: &Conditions) -> Result<Passive, String> {
    let mut results = [[0.0; 3]; HANDS.len()];
    for (result, (velocity, frequency)) in results.iter_mut().zip(HANDS) {
        let hand = |t: f64| velocity * (TAU * frequency * t).sin();
        let (start, end) = (SETTLED_S, SETTLED_S + 2.0 / frequency);
        let mut off = unpowered(index, conditions)?;
        let mut torques = Vec::new();
        for k in 0..(end / DT) as usize {
            off.set_velocity(hand(k as f64 * DT));
            let torque = off.advance(0.0).truth.tau;
            if k as f64 * DT > start {
                torques.push(torque);
            }
        }
        let share = 100.0 / JOINTS[index].2;
        result[0] = share * rms(&torques);
        let damping = |joint: &JointParameters| PASSIVE_DAMPING * joint.gains.k_d;
        let by = |fed_back: bool| -> Result<f64, String> {
            let mut bench = Bench::new(index, conditions)?;
            let damping = damping(&bench.joint);
            let drive = bench.joint.drive_model;
            let mut torques = Vec::new();
            while bench.time() < end {
                let t = bench.time();
                bench.move_link(hand(t));
                let torque = bench.step_by(|seen| match fed_back {
                    true => Wish::Torque(-damping * seen.dq),
                    // D10 with tau* = 0: the drive is led by its link, with friction fed forward.
                    false => Wish::Position(seen.q + drive.friction_part(seen.dq)),
                });
                if t > start {
                    torques.push(torque);
                }
            }
            Ok(share * rms(&torques))
        };
        result[1] = by(false)?;
        result[2] = by(true)?;
    }
    Ok(results)
}

/// A desired motion: two swings, one in the other. `other`: one that nothing was learned from.
fn desired(t: f64, other: bool) -> [f64; 3] {
    let swings = if other {
        [(0.45, 0.14), (0.12, 0.35)]
    } else {
        [(0.5, 0.125), (0.1, 0.4)]
    };
    let mut motion = [START, 0.0, 0.0];
    for (amplitude, frequency) in swings {
        let w = TAU * frequency;
        motion[0] += amplitude * (1.0 - (w * t).cos());
        motion[1] += amplitude * w * (w * t).sin();
        motion[2] += amplitude * w * w * (w * t).cos();
    }
    motion
}

/// The load, of which the joint knows nothing: as heavy as its share of rated torque says, as inert as the
/// robot's links.
fn load(joint: &JointParameters, rated: f64) -> RigLoad {
    let arm = 0.3;
    RigLoad {
        inertia: joint.link_inertia,
        mass: WEIGHT * rated / (GRAVITY * arm),
        arm,
    }
}

/// Measured and desired values of a run.
#[derive(Default)]
struct Run {
    errors: Vec<f64>,
    q: Vec<f64>,
    tau_d: Vec<f64>,
}

impl Run {
    fn error(&self) -> f64 {
        rms(&self.errors).to_degrees()
    }
}

/// Follows the desired motion; `wish` of what is seen and desired.
fn follow(
    index: usize,
    conditions: &Conditions,
    other: bool,
    mut wish: impl FnMut(&JointParameters, &Seen, [f64; 3]) -> Wish,
) -> Result<Run, String> {
    let rated = JOINTS[index].2;
    let mut bench = Bench::with_load(index, conditions, |joint| load(joint, rated))?;
    let joint = bench.joint.clone();
    let mut run = Run::default();
    while bench.time() < END_S {
        let t = bench.time();
        // From rest: the motion's acceleration rises within the first second.
        let motion = desired((t - 0.5).max(0.0), other);
        bench.step_by(|seen| {
            let wish = wish(&joint, seen, motion);
            run.q.push(seen.q);
            run.tau_d.push(match wish {
                Wish::Torque(tau_d) => tau_d,
                Wish::Position(_) => f64::NAN,
            });
            wish
        });
        if t > SETTLED_S {
            run.errors.push(bench.angle() - motion[0]);
        }
    }
    Ok(run)
}

fn feedback(joint: &JointParameters, [k_s, k_d]: [f64; 2], seen: &Seen, motion: [f64; 3]) -> f64 {
    let gains = joint.gains;
    k_s * gains.k_s * (motion[0] - seen.q) + k_d * gains.k_d * (motion[1] - seen.dq)
}

/// Judges how a joint tracks.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn tracked(index: usize, conditions: &Conditions) -> Result<Tracked, String> {
    let drive = follow(index, conditions, false, |_, _, motion| {
        Wish::Position(motion[0])
    })?;
    let without = follow(index, conditions, false, |joint, seen, motion| {
        Wish::Torque(feedback(joint, [1.0; 2], seen, motion))
    })?;
    let mut carried: Option<CarriedTorque> = None;
    let with = follow(index, conditions, false, |joint, seen, motion| {
        let w_c = largest_follow(&joint.gains, &joint.law, joint.link_inertia);
        let carried = carried.get_or_insert(CarriedTorque::at(seen.torque));
        let carried = carried.follow(seen.torque, w_c, DT);
        Wish::Torque(carried + feedback(joint, [1.0; 2], seen, motion))
    })?;
    let nothing = follow(index, conditions, true, |joint, seen, motion| {
        Wish::Torque(feedback(joint, LOW, seen, motion))
    })?;
    // Learned from the motion with torque feedback, used in another one.
    let learned = learn(index, &with)?;
    let gp = LocalGp::new(&learned).map_err(|e| e.to_string())?;
    let fed_forward = follow(index, conditions, true, |joint, seen, motion| {
        let torque = gp.predict(&inputs(motion)).mean;
        Wish::Torque(torque + feedback(joint, LOW, seen, motion))
    })?;
    Ok(Tracked {
        drive: drive.error(),
        feedback: [without.error(), with.error()],
        learned: [nothing.error(), fed_forward.error()],
    })
}

fn inputs(motion: [f64; 3]) -> [f64; MAX_FEATURES] {
    let mut inputs = [0.0; MAX_FEATURES];
    inputs[..3].copy_from_slice(&motion);
    inputs
}

/// Half of the windows of the filters, samples, as long as the loop's.
const HALF: usize = 40;

fn learn(index: usize, run: &Run) -> Result<LocalGpParameters, String> {
    let settled = (SETTLED_S / DT) as usize;
    let filtered = |signal: &[f64], derivative| smooth(signal, derivative, HALF, DT);
    let motion = [0, 1, 2].map(|derivative| filtered(&run.q, derivative));
    let torque = filtered(&run.tau_d, 0);
    let used = settled..run.q.len() - HALF;
    let log = MotionLog {
        inputs: (used.clone())
            .map(|i| inputs([motion[0][i], motion[1][i], motion[2][i]]))
            .collect(),
        missing: used.map(|i| torque[i]).collect(),
    };
    let (_, joint, rated) = JOINTS[index];
    let options = motion_options(joint, rated);
    let trained = train_motion(&log, DT, &options, &mut |_, _| {});
    Ok(trained.map_err(|e| e.to_string())?.parameters)
}

/// Robots with a payload on a link that their model does not have: link's mass in the URDF, and truly.
pub(crate) const LOADED: [(&str, &str, [&str; 2]); 2] = [
    (
        "test-joint",
        "0.92 kg at the end of the link",
        ["1.841", "2.761"],
    ),
    ("leg", "2 kg on the shank", ["2.6", "4.6"]),
];
/// Time from which a robot's tracking is judged, s, and the end. What is learned is learned before.
const JUDGED_S: f64 = 18.0;
const ROBOT_END_S: f64 = 34.0;

/// Root mean square of `q - q_d`, mean over the joints and worst, degrees: by inverse dynamics, by
/// torque-feedback motion, by low gains without and with the learned feed-forward.
pub(crate) type Robots = [[f64; 2]; 4];

/// Judges a robot of [`LOADED`] in the modes of the loop itself.
///
/// # Errors
/// Files that cannot be read; a mode that is not followed.
pub(crate) fn robot(index: usize, conditions: &Conditions) -> Result<Robots, String> {
    let (name, _, [modelled, true_mass]) = LOADED[index];
    let gather = std::cell::RefCell::new(None);
    let run = |mode: Mode, low: bool, learned: Option<&[LocalGpParameters]>, gathers: bool| {
        let mut errors: Vec<Vec<f64>> = Vec::new();
        let gains = std::cell::RefCell::new(Vec::new());
        let change = |robot: &mut Robot, urdf: &mut String| {
            let from = format!("<mass value=\"{modelled}\"/>");
            *urdf = urdf.replace(&from, &format!("<mass value=\"{true_mass}\"/>"));
            let joints = robot.parameters.joints.iter_mut().enumerate();
            for (j, joint) in joints {
                joint.feed_forward = learned.and_then(|learned| learned.get(j)).cloned();
            }
            *gains.borrow_mut() = robot.parameters.joints.iter().map(|j| j.gains).collect();
            if gathers {
                *gather.borrow_mut() = Some(GatherMotion::new(robot));
            }
        };
        let ask = |reference: &mut Reference| {
            if reference.mode == Mode::Hold.number() {
                return;
            }
            reference.mode = mode.number();
            reference.gains_given = u32::from(low);
            for (joint, gains) in reference.joints.iter_mut().zip(&*gains.borrow()) {
                (joint.stiffness, joint.damping) = (LOW[0] * gains.k_s, LOW[1] * gains.k_d);
            }
        };
        let driven = Driven {
            name,
            seconds: if gathers { JUDGED_S } else { ROBOT_END_S },
            conditions,
            change: &change,
            ask: &ask,
        };
        let mut followed = true;
        driven.run(|t, reference, record, truth| {
            if let Some(gather) = gather.borrow_mut().as_mut().filter(|_| gathers) {
                gather.take(record);
            }
            if t <= JUDGED_S {
                return;
            }
            followed &= record.mode == mode.number();
            errors.resize_with(truth.joints.len(), Vec::new);
            for (j, (errors, truth)) in errors.iter_mut().zip(&truth.joints).enumerate() {
                errors.push(truth.q - reference.joints[j].q_d);
            }
        })?;
        if !followed {
            return Err(format!("{name}: mode {} was not followed", mode.name()));
        }
        let all: Vec<f64> = errors.iter().map(|e| rms(e).to_degrees()).collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        Ok([mean, all.iter().copied().fold(0.0, f64::max)])
    };
    let modelled = run(Mode::InverseDynamics, false, None, false)?;
    let by_torque = run(Mode::TorqueFeedbackMotion, false, None, false)?;
    let low = run(Mode::InverseDynamics, true, None, false)?;
    run(Mode::InverseDynamics, false, None, true)?;
    let logs = gather.take().map(GatherMotion::logs).unwrap_or_default();
    let learned = logs.iter().map(|log| {
        let options = motion_options(name, 1.0);
        let trained = train_motion(log, DT, &options, &mut |_, _| {});
        Ok(trained.map_err(|e| e.to_string())?.parameters)
    });
    let learned = learned.collect::<Result<Vec<_>, String>>()?;
    let learned = run(Mode::LowGainTracking, true, Some(&learned), false)?;
    Ok([modelled, by_torque, low, learned])
}

/// Runs the experiments and writes their page.
///
/// # Errors
/// Files that cannot be read or written; a mode that is not followed.
pub(crate) fn write(out: &Path, joints_only: bool) -> Result<(), String> {
    eprintln!("passive mode");
    let (tables, aims) = tables(&cases(), joints_only)?;
    let path = out.join("torque-modes.md");
    let page = format!("{HEAD}{aims}{NOTES}{tables}");
    ResultsPage::new(&page)?.write(&path)
}

fn tables(all: &[Case], joints_only: bool) -> Result<(String, String), String> {
    let cases: Vec<&Case> = all.iter().filter(|case| case.name != "D").collect();
    let passive = parallel(&cases, |case| passive(case.index, &case.conditions))?;
    eprintln!("tracking");
    let tracked = parallel(&cases, |case| tracked(case.index, &case.conditions))?;
    let mut text = PASSIVE.to_owned();
    let tuned = |case: &&Case| case.name == PREDICTIVE;
    let less = |now: f64, before: f64| 100.0 * (1.0 - now / before);
    for (case, result) in cases.iter().zip(&passive).filter(|(case, _)| tuned(case)) {
        let _ = write!(text, "\n| {} |", JOINTS[case.index].1);
        for [off, led, passive] in result {
            let _ = write!(
                text,
                " {off:.1} / {led:.1} / {passive:.2} | {:.0} % |",
                less(*passive, *off)
            );
        }
    }
    text += MOTION;
    for (case, t) in cases.iter().zip(&tracked).filter(|(case, _)| tuned(case)) {
        let ([without, with], [nothing, learned]) = (t.feedback, t.learned);
        let _ = write!(
            text,
            "\n| {} | {:.3} | {without:.3} | {with:.3} | {:.0} % | {nothing:.2} | {learned:.3} | {:.0} % |",
            JOINTS[case.index].1,
            t.drive,
            less(with, without),
            less(learned, nothing),
        );
    }
    text.push('\n');
    if !joints_only {
        eprintln!("robots in these modes");
        let robots = [0, 1];
        let conditions = Conditions::new(shipped());
        let results = parallel(&robots, |&index| robot(index, &conditions))?;
        text += ROBOTS;
        for ((name, payload, _), results) in LOADED.iter().zip(results) {
            let _ = write!(text, "\n| {name}, {payload} |");
            for [mean, worst] in results {
                let _ = write!(text, " {mean:.3} ({worst:.3}) |");
            }
        }
        text.push('\n');
    }
    Ok((text, aims(&cases, &passive, &tracked)))
}

fn aims(cases: &[&Case], passive: &[Passive], tracked: &[Tracked]) -> String {
    let less = |[before, now]: [f64; 2]| 100.0 * (1.0 - now / before);
    let mut text = String::new();
    type Reduction<'a> = &'a dyn Fn(usize) -> f64;
    let hand = |h: usize| move |i: usize| less([passive[i][h][0], passive[i][h][2]]);
    let (slow, quick, quickest) = (hand(0), hand(1), hand(2));
    let lines: [(String, &str, Reduction<'_>); 5] = [
        (of_hand(0), "90", &slow),
        (of_hand(1), "90", &quick),
        (of_hand(2), "90", &quickest),
        (
            "Torque feedback: less tracking error".to_owned(),
            "77",
            &|i| less(tracked[i].feedback),
        ),
        (
            "Low gains: less tracking error by the learned feed-forward".to_owned(),
            "77",
            &|i| less(tracked[i].learned),
        ),
    ];
    for (what, aim, of) in lines {
        let _ = write!(text, "| {what} | by at least {aim} % |");
        for name in [PREDICTIVE, SEEDS, WRONG] {
            let named = (0..cases.len()).filter(|&i| cases[i].name == name);
            let (low, high) = named
                .map(of)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
                    (l.min(x), h.max(x))
                });
            let _ = write!(text, " {low:.0} to {high:.0} % |");
        }
        text.push('\n');
    }
    text
}

fn of_hand(index: usize) -> String {
    let (velocity, frequency) = HANDS[index];
    format!("Passive: less torque to swing a joint, {frequency} Hz, up to {velocity} rad/s")
}

const HEAD: &str = "\
# Passive mode, and tracking by torque feedback and by learning: results

Written by `cargo run --release -p torque-control-bench -- --modes-only`; the modes: [modes.md](../modes.md#passive-mode). Experiments of Z (IV-B, IV-C) and G (V-B) with the predictive law, on the joints and under the disturbances of [torque-control.md](torque-control.md).

## Aims

Over all joints. Nothing was tuned with the other seeds, nor with the law's parameters off by up to 20 % (2 draws).

| | aim | measured | other seeds | parameters ±20 % |
| --- | --- | --- | --- | --- |
";

const NOTES: &str = "
Missed: in passive mode quicker hands, as the drive's damping goes along with slow velocities only.
";

const PASSIVE: &str = "
## Passive mode

Z IV-C: a hand swings the link to and fro. Root mean square of the torque that it feels, % of rated. First with a motor
that makes no torque, then led by its link with friction fed forward (D10 with tau* = 0), last in passive mode, damped
by 0.5 % of K_d. *Less*: than a motor without torque (Z: 50 % with its estimate, 75 % with a torque sensor).

<!-- rows: torque-modes-passive.csv, 2 least of less -->

| joint | 0.1 Hz, up to 0.25 rad/s | less | 0.1 Hz, up to 0.5 rad/s | less | 0.25 Hz, up to 0.5 rad/s | less |
| --- | --- | --- | --- | --- | --- | --- |";

const MOTION: &str = "

## Motion with torque feedback, and by low gains

The link carries an unknown load, 30 % of rated torque at a right angle, and swings by about a radian. Root mean square
of the tracking error, degrees. Z IV-B: drive alone, K_s and K_d, with the carried torque fed back (Z: 75 % less, 80 %
with a torque sensor). G V-B: 5 % of K_s and 20 % of K_d, with a feed-forward learned from another motion (G: 63 % less,
77 % with a torque sensor).

<!-- rows: torque-modes-tracking.csv, 2 least of less -->

| joint | drive alone | K_s, K_d | with torque feedback | less | low gains | with learned feed-forward | less |
| --- | --- | --- | --- | --- | --- | --- | --- |";

const ROBOTS: &str = "
In the loop, in the demo's motion, with a payload that the robot's model does not have: the same error, mean over the
joints (worst joint). The feed-forward is learned from the first 18 s; all are judged on the 16 s after.

| robot | inverse dynamics | torque-feedback motion | inverse dynamics by low gains | low-gain tracking |
| --- | --- | --- | --- | --- |";
