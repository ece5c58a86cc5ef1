//! `[[frame]]`: frames that mode Cartesian leads, with their limits.

use crate::general::name;
use crate::parameters::{FrameParameters, FtParameters, JointParameters};
use crate::reader::{Allowed, Section};
use control::CartesianLimits;
use dynamics::Model;
use problem::listed;
use robot_state::MAX_FRAMES;

const LINK: &str = "the name of a link of the URDF";
/// Joints from which on a limb can change its posture without moving its end.
const REDUNDANT: usize = 7;

/// Without a model the keys alone are read: then something else is wrong, and joints may be missing.
pub(crate) fn read(
    root: &Section<'_, '_>,
    model: Option<&Model>,
    joints: &[JointParameters],
    sensors: &[FtParameters],
) -> Vec<FrameParameters> {
    let mut sections = root.list("frame");
    if sections.len() > MAX_FRAMES {
        let what = format!("{} frames are not allowed", sections.len());
        root.problem(
            "frame",
            what,
            format!("at most {MAX_FRAMES} tables [[frame]]"),
        );
        sections.truncate(MAX_FRAMES);
    }
    let mut frames: Vec<FrameParameters> = Vec::new();
    for mut section in sections {
        let name = name(&section, "name");
        section.which = format!(" ({name})");
        if frames.iter().any(|frame| frame.name == name) {
            section.problem("name", "a second frame has this name", "each frame once");
        }
        let reader = Reader {
            section: &section,
            joints,
            sensors,
        };
        frames.extend(reader.frame(name, model));
        section.finish();
    }
    frames
}

struct Reader<'r, 'n, 't> {
    section: &'r Section<'n, 't>,
    joints: &'r [JointParameters],
    sensors: &'r [FtParameters],
}

impl Reader<'_, '_, '_> {
    /// Reads every key, also where an earlier one is wrong.
    fn frame(&self, name: String, model: Option<&Model>) -> Option<FrameParameters> {
        let section = self.section;
        let link = section.text("link", LINK);
        let base = section.optional_text("base", LINK);
        let positive = |key| section.number(key, Allowed::Positive);
        let share = |key| section.optional_number(key, Allowed::Within(0.0, 50.0));
        let wrench = [positive("force_limit_N"), positive("torque_limit_Nm")];
        let stiffness = [
            positive("stiffness_N_per_m"),
            positive("stiffness_Nm_per_rad"),
        ];
        let velocity = [
            section.number_or("velocity_limit_m_per_s", 0.5, Allowed::Positive),
            section.number_or("velocity_limit_rad_per_s", 2.0, Allowed::Positive),
        ];
        let rise_ms = section.number_or("rise_ms", 300.0, Allowed::Within(50.0, 10_000.0));
        let approach = section.number_or(
            "approach_velocity_per_cent",
            8.0,
            Allowed::Within(1.0, 100.0),
        );
        // On a stiff object the loop's gain margin is 1 / K_f.
        let k_f = section.number_or("K_f", 0.5, Allowed::Within(0.0, 0.5));
        let posture = [
            share("posture_stiffness_per_cent"),
            share("posture_damping_per_cent"),
        ];
        let (link, model) = (link?, model?);
        let found = self.index("link", link.value, model);
        let base = match &base {
            Some(base) => self.index("base", base.value, model),
            None => model.frames().iter().position(|f| f.parent.is_none()),
        };
        let (link, base) = (found?, base?);
        let (from, to) = (model.frames()[base].body, model.frames()[link].body);
        let moves = |joint: &JointParameters| {
            let mut bodies = model.bodies().iter().enumerate().skip(1);
            bodies.any(|(b, body)| {
                body.joint == joint.model_index
                    && model.supports(b, to)
                    && !(model.supports(b, from))
            })
        };
        let limb: Vec<usize> = (self.joints.iter().enumerate())
            .filter(|(_, joint)| moves(joint))
            .map(|(j, _)| j)
            .collect();
        let stiff = if limb.len() >= REDUNDANT { 2.0 } else { 0.0 };
        let posture = [posture[0].unwrap_or(stiff), posture[1].unwrap_or(5.0)];
        if !model.supports(from, to) {
            let what = "the frame is not beyond it";
            section.problem("base", what, "a link before the frame's, or no such key");
            return None;
        }
        if limb.is_empty() {
            let what = "no joint moves it";
            section.problem("link", what, "a link beyond at least one joint");
            return None;
        }
        if let Some(rigid) = (limb.iter().map(|&j| &self.joints[j]))
            .find(|joint| !(joint.gains.k_s > 0.0 && joint.gains.k_d > 0.0))
        {
            let what = format!("joint {} has no stiffness or no damping", rigid.name);
            let allowed = "gains above 0 of every joint that moves the frame";
            section.problem("link", what, allowed);
            return None;
        }
        if posture[1] < posture[0] {
            let what = "the posture would swing";
            let allowed = "at least posture_stiffness_per_cent";
            section.problem("posture_damping_per_cent", what, allowed);
        }
        Some(FrameParameters {
            name,
            link,
            base,
            joints: limb,
            sensor: self.sensor(model, from, to),
            limits: CartesianLimits {
                wrench,
                rise_s: 1e-3 * rise_ms,
                stiffness,
                velocity,
                k_f,
            },
            posture_stiffness: 0.01 * posture[0],
            posture_damping: 0.01 * posture[1],
            approach: 0.01 * approach,
        })
    }

    /// The sensor nearest before the frame, or else the only one beyond it: the forces that it measures are
    /// those on the frame.
    fn sensor(&self, model: &Model, from: usize, to: usize) -> Option<usize> {
        let all = || {
            let bodies = self.sensors.iter().enumerate();
            bodies.filter_map(|(s, ft)| {
                let frame = model.frame_index(&ft.sensor.frame)?;
                Some((model.frames()[frame].body, s))
            })
        };
        let before = all().filter(|&(b, _)| model.supports(b, to) && !model.supports(b, from));
        let mut beyond = all().filter(|&(b, _)| model.supports(to, b));
        let nearest = before.max().map(|(_, s)| s);
        nearest.or_else(|| match (beyond.next(), beyond.next()) {
            (Some((_, s)), None) => Some(s),
            _ => None,
        })
    }

    fn index(&self, key: &'static str, link: &str, model: &Model) -> Option<usize> {
        let found = model.frame_index(link);
        if found.is_none() {
            let what = format!("the URDF has no link {link}");
            let names = model.frames().iter().map(|frame| frame.name.as_str());
            self.section.problem(key, what, listed(names));
        }
        found
    }
}
