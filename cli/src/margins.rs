//! `torquectl margins`: how wrong the model of a joint may be before its torque loop rings.

use crate::output::finish_or_refuse;
use charts::{COLOURS, Figure, Line, Panel};
use control::margins::{Load, NEEDED, Point, largest_damping};
use control::predictive::Design;
use problem::{Problem, Problems};
use robot_config::Robot;
use robot_config::torque_loops::{
    LeastMargins, LoopLaw, LoopMargins, TorqueLoop, refused_holds, torque_loops, without_space,
};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use terminal::TextTable;

const EXAMPLES: &str = "\
Examples:
  torquectl margins config/leg/robot.toml
  torquectl margins config/leg/robot.toml --joint knee --plot knee.svg
  torquectl margins --json config/humanoid/robot.toml

The loop is opened at the motor's torque. Loads: blocked link; blocked link with the rotor stuck in its
friction; free link; free link of a fifth of the inertia; link on a spring of a third of the gear's
stiffness. With K_s and K_d: free links of once, a fifth and five times the inertia. hand: help for a
hand that turns the joint round. docs/control.md explains the figures.

Exit codes:
  0  every joint has at least 30 degrees and 6 dB
  2  a joint has less, or the configuration has a problem";

/// Print the margins of every joint's torque loop: of the predictive law, and of the feedback of joints without a
/// link-side encoder.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct MarginsArguments {
    /// The robot's configuration
    #[arg(value_name = "CONFIG")]
    config: String,
    /// One joint [default: all]
    #[arg(long)]
    joint: Option<String>,
    /// Draw Bode and Nyquist curves of a joint's loop into this file
    #[arg(long, value_name = "FILE.svg", requires = "joint")]
    plot: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &MarginsArguments) -> ExitCode {
    finish_or_refuse(report(arguments))
}

fn report(arguments: &MarginsArguments) -> Result<String, Problems> {
    let read = |path: &str| terminal::read_text(path);
    let robot = robot_config::load(&arguments.config, &read)?;
    let mut loops = torque_loops(&robot);
    if let Some(name) = &arguments.joint {
        let names: Vec<&str> = loops.iter().map(|l| l.name.as_str()).collect();
        let what = format!("--joint {name}: the robot has no such joint");
        let problem = Problem::new(what, names.join(", "));
        loops.retain(|l| l.name == *name);
        if loops.is_empty() {
            return Err(problem.into());
        }
    }
    let judged = judge_loops(&loops);
    if let (Some(path), Some(of_joint)) = (&arguments.plot, loops.first()) {
        figure(of_joint).write(path).map_err(Problems::from)?;
    }
    let refused = refusals(&robot, &judged, &arguments.config);
    if !refused.is_empty() {
        return Err(Problems(refused));
    }
    Ok(if arguments.json {
        format!("{:#}\n", Value::from(objects(&judged)))
    } else {
        format!("{}{NOTE}{}", table(&judged), designs(&judged))
    })
}

/// Remarks that the table's heads leave out.
pub(crate) const NOTE: &str = "\
K_i: of joints without a link-side encoder, chosen by the margins where none is given; torque: bandwidth
of the torque with a blocked link, without friction and stuck in it; phase and gain margins over the five loads; with K_s, K_d: over the three free links; K_s, K_d most: alone, at 30
degrees and 6 dB, K_s with the configured K_d / K_s\n";

/// The loop of one joint, judged.
pub(crate) struct JudgedJoint {
    /// The loop itself.
    of_joint: TorqueLoop,
    /// K_i of the feedback of a late torque, 1/s.
    k_i: Option<f64>,
    /// Bandwidths and damping of the predictive law.
    design: Option<Design>,
    bandwidth: [f64; 2],
    margins: LoopMargins,
    most: [f64; 2],
}

/// Judges the loops by which the robot's joints are controlled.
pub(crate) fn judge(robot: &Robot) -> Vec<JudgedJoint> {
    let mut loops = torque_loops(robot);
    loops.retain(|of_joint| of_joint.bound);
    judge_loops(&loops)
}

/// Judges loops on all cores.
fn judge_loops(joints: &[TorqueLoop]) -> Vec<JudgedJoint> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..cores.min(joints.len()) {
            scope.spawn(|| {
                while let Some((index, joint)) = {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    joints.get(index).map(|joint| (index, joint))
                } {
                    let judged = judge_joint(joint);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, judged));
                    }
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, judged)| judged).collect()
}

fn judge_joint(joint: &TorqueLoop) -> JudgedJoint {
    let stuck = [Load::Blocked, Load::Stuck];
    let (k_i, design, bandwidth, most_damping) = match &joint.law {
        LoopLaw::Predictive(space) => {
            let torque = without_space(space);
            (
                None,
                Some(space.law.design),
                stuck.map(|load| torque.with(load).bandwidth()),
                largest_damping(&torque, NEEDED),
            )
        }
        LoopLaw::Late(space) => {
            let torque = space.of_torque();
            (
                Some(space.gains.k_i),
                None,
                stuck.map(|load| torque.bandwidth(load)),
                torque.largest_damping(NEEDED),
            )
        }
    };
    JudgedJoint {
        of_joint: joint.clone(),
        k_i,
        design,
        bandwidth,
        margins: joint.margins(),
        most: [joint.largest_stiffness(), most_damping],
    }
}

/// A problem for each joint that has too little margin by the law that it follows, or in its hold.
pub(crate) fn refusals(robot: &Robot, judged: &[JudgedJoint], file: &str) -> Vec<Problem> {
    let bound = judged.iter().filter(|joint| joint.of_joint.bound);
    bound
        .flat_map(|joint| joint.of_joint.refusals(&joint.margins, file))
        .chain(refused_holds(robot, file))
        .collect()
}

/// A line for each joint whose drive and gear have needed another design than the default, and one for those whose
/// torque law does not help a hand.
pub(crate) fn designs(judged: &[JudgedJoint]) -> String {
    let hz = |bandwidth: f64| bandwidth / TAU;
    let default = Design::default();
    let alone: Vec<&str> = (judged.iter())
        .filter(|joint| joint.design.is_some_and(|design| design.assist <= 0.0))
        .map(|joint| joint.of_joint.name.as_str())
        .collect();
    let alone = if alone.is_empty() {
        String::new()
    } else {
        format!(
            "no help for a hand that turns the joint round, as a loop with it would ring: {}\n",
            alone.join(", ")
        )
    };
    let other = judged.iter().filter_map(|joint| {
        let d = joint.design?;
        let linear = Design {
            assist_bandwidth: default.assist_bandwidth,
            assist: default.assist,
            ..d
        };
        (linear != default).then(|| format!(
            "{}: s {:.2}, zeta {:.1}, observers {:.0} Hz (rotor) and {:.0} Hz (link), follow {:.0} Hz instead of \
             1, 1, 40, 25 and 10, with which drive and gear would have less than 30 degrees or 6 dB\n",
            joint.of_joint.name, d.stiffness, d.damping, hz(d.rotor), hz(d.link), hz(d.follow),
        ))
    });
    alone + &other.collect::<String>()
}

/// The joints as a table.
pub(crate) fn table(judged: &[JudgedJoint]) -> String {
    let head = [
        "joint",
        "K_i 1/s",
        "torque",
        "stuck",
        "phase",
        "at",
        "gain",
        "at",
        "with K_s, K_d",
        "at",
        "gain",
        "less gain",
        "K_s most",
        "K_d most",
        "hand",
    ];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    for joint in judged {
        let ((torque, at), (space, space_at)) = (&joint.margins.torque, &joint.margins.space);
        let (degrees, db) = torque.in_degrees_and_db();
        let (space_degrees, space_db) = space.in_degrees_and_db();
        rows.push(vec![
            joint.of_joint.name.clone(),
            (joint.k_i).map_or_else(|| "-".to_owned(), |k_i| format!("{k_i:.1}")),
            format!("{:.0} Hz", joint.bandwidth[0]),
            format!("{:.0} Hz", joint.bandwidth[1]),
            format!("{degrees:.0} deg"),
            at[0].name().to_owned(),
            format!("{db:.0} dB"),
            at[1].name().to_owned(),
            format!("{space_degrees:.0} deg"),
            space_at[0].name().to_owned(),
            format!("{space_db:.0} dB"),
            format!("{:.0} dB", 20.0 * space.reduction.log10()),
            format!(
                "{:.0} {}",
                joint.most[0],
                joint.of_joint.joint_kind.units("N·m/rad")
            ),
            format!(
                "{:.1} {}",
                joint.most[1],
                joint.of_joint.joint_kind.units("N·m·s/rad")
            ),
            (joint.design.filter(|design| design.assist > 0.0))
                .map_or_else(|| "-".to_owned(), |design| format!("{:.1}", design.assist)),
        ]);
    }
    TextTable(rows).to_string()
}

/// The joints as JSON.
pub(crate) fn objects(judged: &[JudgedJoint]) -> Vec<Value> {
    let margins = |(margins, at): &LeastMargins| {
        let (degrees, db) = margins.in_degrees_and_db();
        // Infinite ones are left out: JSON has none.
        json!({
            "phase_deg": degrees,
            "phase_load": at[0].name(),
            "gain_dB": db,
            "gain_load": at[1].name(),
            "gain_reduction_dB": 20.0 * margins.reduction.log10(),
        })
    };
    let object = |joint: &JudgedJoint| {
        // Only these keys have units of the joint: a phase is in degrees.
        let [stiffness, damping] = ["largest_K_s_Nm_per_rad", "largest_K_d_Nms_per_rad"]
            .map(|key| joint.of_joint.joint_kind.units(key));
        json!({
            "name": joint.of_joint.name,
            "K_i_per_s": joint.k_i,
            "design": joint.design.map(|design| json!({
                "s": design.stiffness,
                "zeta": design.damping,
                "rotor_observer_Hz": design.rotor / TAU,
                "link_observer_Hz": design.link / TAU,
                "follow_Hz": design.follow / TAU,
                "hand_Hz": design.assist_bandwidth / TAU,
                "help": design.assist,
            })),
            "bandwidth_Hz": joint.bandwidth[0],
            "bandwidth_stuck_Hz": joint.bandwidth[1],
            "torque": margins(&joint.margins.torque),
            "with_K_s_K_d": margins(&joint.margins.space),
            (stiffness): joint.most[0],
            (damping): joint.most[1],
        })
    };
    judged.iter().map(object).collect()
}

/// A load with the responses of the open loop and of the torque.
type Curve = (Load, Vec<Point>, Vec<Point>);

/// Bode and Nyquist curves of the open loop, and the torque's response, at every load.
fn figure(joint: &TorqueLoop) -> Figure {
    let curves: Vec<Curve> = (Load::ALL.iter())
        .map(|&load| match &joint.law {
            LoopLaw::Predictive(space) => {
                let closed = without_space(space).with(load);
                (load, closed.open_loop(), closed.torque_response())
            }
            LoopLaw::Late(space) => {
                let torque = space.of_torque();
                (load, torque.open_loop(load), torque.torque_response(load))
            }
        })
        .collect();
    let lines = |of: &dyn Fn(&Curve) -> Vec<(f64, f64)>| {
        let coloured = curves.iter().zip(COLOURS);
        coloured
            .map(|(curve, colour)| Line::new(curve.0.name(), colour, of(curve)))
            .collect::<Vec<_>>()
    };
    let db = |p: &Point| (p.frequency, 20.0 * p.gain().log10());
    let panel = |caption: &str, lines: Vec<Line>| Panel {
        caption: caption.to_owned(),
        x_unit: " Hz".to_owned(),
        x_logarithmic: true,
        lines,
        ..Panel::default()
    };
    let near = |p: &&Point| p.re.abs() < 3.0 && p.im.abs() < 3.0;
    let nyquist = |curve: &Curve| curve.1.iter().filter(near).map(|p| (p.re, p.im)).collect();
    let mut nyquist_lines: Vec<Line> = lines(&nyquist)
        .into_iter()
        .map(|line| line.with_mark(charts::Mark::Path))
        .collect();
    let critical = Line::new("critical point", COLOURS[5], vec![(-1.0, 0.0)]);
    nyquist_lines.push(critical.with_mark(charts::Mark::Dots));
    Figure {
        title: format!("{}: torque loop, opened at the motor's torque", joint.name),
        columns: 2,
        panel_size: (420, 260),
        panels: vec![
            panel("open loop, dB", lines(&|c| c.1.iter().map(db).collect())),
            panel(
                "open loop, degrees",
                lines(&|c| {
                    let phase = |p: &Point| (p.frequency, p.phase().to_degrees());
                    c.1.iter().map(phase).collect()
                }),
            ),
            Panel {
                caption: "open loop, imaginary over real part".to_owned(),
                x_range: Some((-3.0, 3.0)),
                y_range: Some((-3.0, 3.0)),
                lines: nyquist_lines,
                ..Panel::default()
            },
            panel(
                "torque over desired torque, dB",
                lines(&|c| c.2.iter().map(db).collect()),
            ),
        ],
    }
}
