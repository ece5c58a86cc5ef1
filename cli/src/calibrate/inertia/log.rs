//! Which column of a log belongs to which joint.

use crate::rows::{Rows, open};
use dynamics::{JointKind, Model};
use identification::inertia::{JointColumns, RobotLog};
use problem::{Problem, listed};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Names of the column of stamps.
const TIMES: [&str; 6] = ["t", "time", "t_s", "time_s", "timestamp", "stamp"];
/// Signals: names of their columns.
const SIGNALS: [(&str, &[&str]); 4] = [
    ("q", &["q"]),
    ("dq", &["dq", "qd"]),
    ("ddq", &["ddq", "qdd"]),
    ("tau", &["tau"]),
];

/// The joints of the columns.
pub(super) struct Columns<'a> {
    model: &'a Model,
    /// Joints with a torque, as indices of the model's.
    measured: Vec<usize>,
    /// Columns carry names instead of numbers.
    named: bool,
    /// Number of the first joint.
    first: usize,
    notes: Vec<String>,
}

/// Meaning of a column's name: signal and joint's number or name.
fn meaning(column: &str) -> Option<(usize, &str)> {
    let all = SIGNALS
        .iter()
        .enumerate()
        .flat_map(|(k, (_, names))| names.iter().map(move |n| (k, *n)));
    for (signal, name) in all {
        if let Some(rest) = column.strip_prefix(name) {
            let number = rest.strip_prefix('_').unwrap_or(rest);
            if !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()) {
                return Some((signal, number));
            }
            if let Some(joint) = rest.strip_prefix('_').filter(|j| !j.is_empty()) {
                return Some((signal, joint));
            }
        }
        if let Some(joint) = column.strip_suffix(name).and_then(|c| c.strip_suffix('.')) {
            return Some((signal, joint));
        }
    }
    None
}

impl<'a> Columns<'a> {
    /// By the header of the first log.
    ///
    /// # Errors
    /// Columns that do not belong to joints of the URDF, or whose joints are not clear.
    pub(super) fn new(
        model: &'a Model,
        urdf: &str,
        chosen: &[String],
        logs: &[PathBuf],
    ) -> Result<Self, Problem> {
        let Some(path) = logs.first() else {
            return Err(Problem::new("no log", "--log LOG.csv"));
        };
        let log = path.display().to_string();
        let header = open(path, None)?.names().to_vec();
        let found: Vec<(usize, &str)> = header.iter().filter_map(|c| meaning(c)).collect();
        let is_joint = |name: &str| model.joint_index(name).is_some();
        let of = |signal: usize| -> Vec<&str> {
            found
                .iter()
                .filter(|(s, _)| *s == signal)
                .map(|(_, joint)| *joint)
                .collect()
        };
        let (angles, torques) = (of(0), of(3));
        for (signal, columns) in [("q", &angles), ("tau", &torques)] {
            if columns.is_empty() {
                let among = listed(header.iter().map(String::as_str));
                let reason =
                    format!("no columns {signal}1, {signal}2, .. or {signal}_NAME among {among}");
                let allowed =
                    "t, q1.. and tau1.., or q_NAME and tau_NAME with the URDF's names of joints";
                return Err(Problem::new(reason, allowed).at(log, 1));
            }
        }
        let mut columns = Self {
            model,
            measured: Vec::new(),
            named: torques.iter().any(|j| is_joint(j)),
            first: 1,
            notes: Vec::new(),
        };
        if columns.named {
            columns.measured = columns.by_name(&torques, &log)?;
            return Ok(columns);
        }
        if let Some(odd) = torques.iter().find(|j| j.parse::<usize>().is_err()) {
            let reason = format!("`tau_{odd}`: the URDF has no joint \"{odd}\" that moves");
            return Err(Problem::new(reason, listed(model.joint_names())).at(log, 1));
        }
        let numbers: Vec<usize> = torques.iter().filter_map(|j| j.parse().ok()).collect();
        columns.first = usize::from(!numbers.contains(&0));
        for number in columns.first..columns.first + numbers.len() {
            if !numbers.contains(&number) {
                let reason = format!(
                    "tau columns of {} joints, but no tau{number}",
                    numbers.len()
                );
                return Err(Problem::new(reason, "joints counted without gaps").at(log, 1));
            }
        }
        columns.measured = columns.by_number(numbers.len(), chosen, urdf, &log)?;
        Ok(columns)
    }

    /// Joints that are measured, as indices of the model's.
    pub(super) fn measured(&self) -> &[usize] {
        &self.measured
    }

    /// Remarks for the user.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    fn by_name(&mut self, torques: &[&str], log: &str) -> Result<Vec<usize>, Problem> {
        let known = |name: &&str| {
            self.model.joint_index(name).ok_or_else(|| {
                let reason = format!("`tau_{name}`: the URDF has no joint \"{name}\" that moves");
                Problem::new(reason, listed(self.model.joint_names())).at(log, 1)
            })
        };
        let mut joints = torques.iter().map(known).collect::<Result<Vec<_>, _>>()?;
        joints.sort_unstable();
        self.note_rest(&joints);
        Ok(joints)
    }

    fn by_number(
        &mut self,
        count: usize,
        chosen: &[String],
        urdf: &str,
        log: &str,
    ) -> Result<Vec<usize>, Problem> {
        let names: Vec<&str> = self.model.joint_names().collect();
        if !chosen.is_empty() {
            let known = |name: &String| {
                self.model.joint_index(name).ok_or_else(|| {
                    let reason = format!("--joints: the URDF has no joint \"{name}\" that moves");
                    Problem::new(reason, listed(names.iter().copied())).at(urdf, 0)
                })
            };
            let joints = chosen.iter().map(known).collect::<Result<Vec<_>, _>>()?;
            let twice = (0..joints.len()).find(|&k| joints[..k].contains(&joints[k]));
            if joints.len() != count || twice.is_some() {
                let reason = format!(
                    "--joints names {} joints, the log has tau columns of {count}",
                    joints.len()
                );
                return Err(Problem::new(reason, "each joint once, one for each column").at(log, 1));
            }
            self.note_rest(&joints);
            return Ok(joints);
        }
        let joints = self.model.joints();
        let arm = chain(self.model);
        // Fingers beyond the arm.
        let fingers = arm.len() < joints.len()
            && joints
                .iter()
                .enumerate()
                .all(|(k, j)| arm.contains(&k) || j.kind == JointKind::Prismatic);
        if arm.len() == count && (arm.len() == joints.len() || fingers) {
            self.note_rest(&arm);
            return Ok(arm);
        }
        let reason = format!(
            "the log has tau columns of {count} joints, \"{urdf}\" has {} that move: {}",
            joints.len(),
            names.join(", ")
        );
        let allowed = if arm.len() == joints.len() || count < joints.len() {
            "as many, or --joints NAME,NAME.. for the joints of the columns (others at rest), or columns q_NAME, tau_NAME"
        } else {
            "columns by name (q_NAME, tau_NAME) where the URDF branches, or --joints NAME,NAME.."
        };
        Err(Problem::new(reason, allowed).at(log, 1))
    }

    fn note_rest(&mut self, joints: &[usize]) {
        let all = self.model.joint_names().enumerate();
        let others: Vec<&str> = all
            .filter(|(k, _)| !joints.contains(k))
            .map(|(_, name)| name)
            .collect();
        if !others.is_empty() {
            self.notes.push(format!(
                "joints without columns are taken to rest at zero: {}",
                listed(others)
            ));
        }
    }

    /// Reads a log; torques with the opposite sign where that is asked for.
    ///
    /// # Errors
    /// A file that cannot be read, with its line; columns that are missing.
    pub(super) fn read(&self, path: &Path, negate_torque: bool) -> Result<RobotLog, Problem> {
        let log = path.display().to_string();
        let mut rows = Rows::read_in_order_of_rows(path, &TIMES, |c| meaning(c).is_some())?;
        let mut by_meaning: BTreeMap<(usize, String), Vec<f64>> = BTreeMap::new();
        for (name, values) in std::mem::take(&mut rows.columns) {
            if let Some((signal, joint)) = meaning(&name) {
                by_meaning.insert((signal, joint.to_owned()), values);
            }
        }
        let mut joints = vec![None; self.model.joint_count()];
        for (k, &joint) in self.measured.iter().enumerate() {
            let name = if self.named {
                self.model.joints()[joint].name.clone()
            } else {
                (self.first + k).to_string()
            };
            let mut take = |signal: usize| by_meaning.remove(&(signal, name.clone()));
            let mut needed = |signal: usize| {
                let missing = || {
                    let reason = format!(
                        "column `{}{}{name}` is missing",
                        SIGNALS[signal].0,
                        if self.named { "_" } else { "" }
                    );
                    Problem::new(reason, "q and tau of every joint").at(log.as_str(), 1)
                };
                take(signal).ok_or_else(missing)
            };
            let (q, mut tau) = (needed(0)?, needed(3)?);
            if negate_torque {
                tau.iter_mut().for_each(|x| *x = -*x);
            }
            joints[joint] = Some(JointColumns {
                q,
                tau,
                dq: take(1).unwrap_or_default(),
                ddq: take(2).unwrap_or_default(),
            });
        }
        Ok(RobotLog {
            name: log,
            t: rows.t,
            joints,
        })
    }
}

/// Joints from the root outwards as long as each carries one other.
fn chain(model: &Model) -> Vec<usize> {
    let bodies = model.bodies();
    let (mut at, mut joints) = (0, Vec::new());
    loop {
        let carried: Vec<usize> = (1..bodies.len())
            .filter(|&b| bodies[b].parent == at)
            .collect();
        match carried[..] {
            [next] => {
                if !joints.contains(&bodies[next].joint) {
                    joints.push(bodies[next].joint);
                }
                at = next;
            }
            _ => return joints,
        }
    }
}
