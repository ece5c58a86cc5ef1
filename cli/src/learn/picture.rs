//! `--plot FILE.svg`: what the model missed, what was learned of it, and the motion.

use charts::{COLOURS, Figure, Line, Panel};
use estimators::local_gp::LocalGp;
use identification::gaussian_process::MotionLog;
use joint_file::TrainedLocalGp;
use problem::Problem;
use robot_config::JointParameters;
use torqued_client::robot_state::JointKind;

/// Points of a curve at most.
const POINTS: usize = 2000;

/// One joint: the torque that its model missed and the learned one on the same motion, and what of it is left.
///
/// # Errors
/// Models that cannot be evaluated.
pub(super) fn panel(
    joint: &JointParameters,
    log: &MotionLog,
    sample_period: f64,
    trained: &TrainedLocalGp,
) -> Result<Panel, Problem> {
    let learned = LocalGp::new(&trained.parameters)?;
    let samples = log.inputs.len().min(log.missing.len());
    let (mut missing, mut found, mut left) = (Vec::new(), Vec::new(), Vec::new());
    for k in (0..samples).step_by(samples.div_ceil(POINTS).max(1)) {
        let (t, inputs, torque) = (k as f64 * sample_period, &log.inputs[k], log.missing[k]);
        let known = torque.is_finite() && inputs.iter().all(|x| x.is_finite());
        let prediction = known.then(|| learned.predict(inputs).mean);
        // Unknown values leave a gap.
        missing.push((t, torque));
        found.push((t, prediction.unwrap_or(f64::NAN)));
        left.push((t, prediction.map_or(f64::NAN, |u| torque - u)));
    }
    let unit = match joint.kind {
        JointKind::Revolute => "N·m",
        JointKind::Prismatic => "N",
    };
    Ok(Panel {
        caption: format!("{}, {unit}", joint.name),
        x_unit: "s".to_owned(),
        lines: vec![
            Line::new("missing in the model", COLOURS[0], missing),
            Line::new("learned", COLOURS[2], found),
            Line::new("left", COLOURS[1], left),
        ],
        ..Panel::default()
    })
}

/// The joints' panels.
pub(super) fn figure(robot: &str, panels: Vec<Panel>) -> Figure {
    Figure {
        title: format!("{robot}: learned feed-forward"),
        columns: if panels.len() > 3 { 2 } else { 1 },
        panel_size: (700, 200),
        panels,
    }
}
