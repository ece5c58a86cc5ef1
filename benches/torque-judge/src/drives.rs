//! Real drives without any torque reference: what the inspection of logs says where the motor's torque is
//! offered as one (KUKA KR300, three axes with encoders on both sides).

use identification::excitation::Quantity;
use identification::inputs::{LogKind, inspect};
use identification::log::LogRow;
use problem::{Problem, Problems};
use std::path::Path;

/// Axes of a run.
const AXES: usize = 3;
/// The motor side is logged behind the gear; the ratio is one of gears of that size and cancels.
const RATIO: f64 = 200.0;

const JOINT: &str = "[joint]\nname = \"axis\"\ngear_ratio = 200.0\ntorque_constant_Nm_per_A = 1.0\n\
    rotor_inertia_kg_m2 = 5e-3\nrated_torque_Nm = 4000.0\nlink_counts_per_turn = 4194304.0\n\
    motor_counts_per_turn = 1048576.0\nsample_rate_hz = 250.0\n";

/// An axis of a run with a reference that is none.
#[derive(Debug, Clone)]
pub struct Offered {
    /// Run and axis.
    pub axis: String,
    /// The reference.
    pub reference: &'static str,
    /// The verdict.
    pub said: String,
    /// Whether the stiffness passes as determined: a defect.
    pub determined: bool,
}

/// Every axis of the runs `A.csv` and `B.csv` of a folder.
///
/// # Errors
/// Logs that cannot be read.
pub fn judge(folder: &Path) -> Result<Vec<Offered>, Problem> {
    let joint = joint_file::JointFile::parse(JOINT, "axis", &joint_file::no_files)?;
    let mut all = Vec::new();
    for run in ["A", "B"] {
        let path = folder.join(format!("{run}.csv"));
        for axis in 0..AXES {
            let own = read(&path, axis)?;
            for reference in ["none", "motor torque"] {
                let of = |row: &LogRow| match reference {
                    "none" => f64::NAN,
                    _ => RATIO * row.current,
                };
                let rows: Vec<LogRow> = (own.iter())
                    .map(|row| LogRow {
                        tau_sensor: of(row),
                        ..*row
                    })
                    .collect();
                let (determined, said) = match inspect(&joint, &rows, LogKind::Training) {
                    Ok(found) => {
                        let excitation = found.excitation.as_ref();
                        let determined =
                            excitation.is_some_and(|e| e.determines(Quantity::Compliance));
                        let undetermined =
                            excitation.and_then(|e| e.undetermined(Quantity::Compliance));
                        let said = undetermined.map_or(String::new(), |c| c.sentence());
                        (determined, said)
                    }
                    Err(Problems(problems)) => {
                        let said: Vec<&str> = problems.iter().map(|p| p.reason.as_str()).collect();
                        (false, format!("refused: {}", said.join("; ")))
                    }
                };
                all.push(Offered {
                    axis: format!("{run}, axis {}", axis + 1),
                    reference,
                    said,
                    determined,
                });
            }
        }
    }
    Ok(all)
}

/// Rows of one axis; the current is the motor's torque.
fn read(path: &Path, axis: usize) -> Result<Vec<LogRow>, Problem> {
    let name = path.display().to_string();
    let refuse = |line: usize, why: String| Problem::new(why, "").at(name.as_str(), line);
    let text = std::fs::read_to_string(path).map_err(|e| refuse(0, e.to_string()))?;
    let mut rows = Vec::new();
    for (i, line) in text.lines().enumerate().skip(1) {
        let fields: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
        let fields = fields.map_err(|e| refuse(i + 1, e.to_string()))?;
        let [motor, link, torque] = [1, 2, 3].map(|k| fields.get(3 * axis + k).copied());
        let (Some(motor), Some(link), Some(torque)) = (motor, link, torque) else {
            return Err(refuse(i + 1, "fields are missing".to_owned()));
        };
        rows.push(LogRow {
            t: fields[0],
            theta: RATIO * motor.to_radians(),
            q: link.to_radians(),
            current: torque,
            tau_sensor: f64::NAN,
            feed_forward: f64::NAN,
        });
    }
    Ok(rows)
}
