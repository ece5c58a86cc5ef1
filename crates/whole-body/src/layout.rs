//! The tree cut into parts and pieces: places of bodies, sensors and joints in it, names resolved
//! and checked once.
//!
//! F/T sensors cut the tree of links into parts: part 0 holds the root link, part `s + 1` all links
//! beyond sensor `s` up to the next ones. A cut may run through a body (links held together by fixed
//! joints), so bodies fall into pieces, one for each part that they extend into.

use crate::error::WholeBodyError;
use crate::parameters::{FtSensorParameters, MotionSource, Place, WholeBodyParameters};
use dynamics::{Inertia, Model, Se3};
use nalgebra::Vector3;
use problem::{Allowed, Problem};

/// The share of a body that belongs to one part.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    pub(crate) body: usize,
    pub(crate) part: usize,
    /// In the body's frame.
    pub(crate) inertia: Inertia,
}

/// An F/T sensor's place in the tree.
#[derive(Debug, Clone)]
pub(crate) struct Sensor {
    /// The caller's index of it.
    pub(crate) input: usize,
    /// The body whose frame the sensor's is fixed to, and the sensor's frame in it.
    pub(crate) body: usize,
    pub(crate) placement: Se3,
    /// The part before it; the part beyond is the sensor's index + 1.
    pub(crate) before: usize,
    /// The piece before it.
    pub(crate) before_piece: usize,
    /// Joints of the part before it that carry it, outermost first.
    pub(crate) carriers: Vec<usize>,
}

/// A part of the robot between sensors.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// The piece nearest to the root.
    pub(crate) root_piece: usize,
    /// The part's first link, in whose frame its wrenches are, and that frame in its body's.
    pub(crate) first_link: usize,
    pub(crate) placement: Se3,
    /// Sensors that bound it: index and the sign of the reading as a wrench on the part.
    pub(crate) boundary: Vec<(usize, f64)>,
    /// Bodies whose joints belong to it.
    pub(crate) joints: Vec<usize>,
    pub(crate) fixed_by_stand: bool,
}

/// The whole tree in the order of the estimator.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    /// The model's index of each joint, in the order of the parameters.
    pub(crate) joints: Vec<usize>,
    /// Sensors in the order of their links in the model.
    pub(crate) sensors: Vec<Sensor>,
    pub(crate) parts: Vec<Part>,
    /// The first pieces, one per body: links held to each body's joint.
    pub(crate) pieces: Vec<Piece>,
    /// The part of each link.
    pub(crate) part_of_link: Vec<usize>,
    /// Per body: the piece that carries its joint.
    pub(crate) carrier: Vec<usize>,
    /// Per body: the part its joint belongs to.
    pub(crate) joint_part: Vec<usize>,
    /// Per body: the sensor that cuts it off right at its joint.
    pub(crate) cut_at_joint: Vec<Option<usize>>,
    /// The body of the IMU or the stand, the frame in it, and bodies whose joints move it.
    pub(crate) source_body: usize,
    pub(crate) source_placement: Se3,
    pub(crate) source_path: Vec<usize>,
    /// g in the stand's link, if a stand is the source.
    pub(crate) fixed_gravity: Option<Vector3<f64>>,
}

impl Layout {
    pub(crate) fn new(model: &Model, p: &WholeBodyParameters) -> Result<Self, WholeBodyError> {
        let joints = joints(model, p)?;
        let cuts = cuts(model, &p.ft_sensors)?;
        let frames = model.frames();
        let part_of_link: Vec<usize> = (0..frames.len())
            .map(|link| part_of(model, &cuts, link))
            .collect();
        let pieces = pieces(model, &part_of_link);
        let bodies = model.bodies().len();
        let mut carrier = vec![0; bodies];
        let mut joint_part = vec![0; bodies];
        let mut cut_at_joint = vec![None; bodies];
        for (i, link) in frames.iter().enumerate() {
            let (false, Some(parent)) = (link.rigid, link.parent) else {
                continue;
            };
            carrier[link.body] = piece_of(&pieces, frames[parent].body, part_of_link[parent]);
            joint_part[link.body] = part_of_link[parent];
            cut_at_joint[link.body] = cuts.iter().position(|(cut, _)| *cut == i);
        }
        let (place, fixed_gravity) = match &p.source {
            MotionSource::Imu(imu) => (imu.frame.clone(), None),
            MotionSource::Fixed { link, gravity } => (Place::link(link), Some(*gravity)),
        };
        let owner = if fixed_gravity.is_some() {
            "fixed base"
        } else {
            "IMU"
        };
        let source_link = find(model, owner, &place.link)?;
        let (source_body, source_placement) = resolve(model, owner, &place)?;
        let mut layout = Self {
            joints,
            sensors: Vec::new(),
            parts: Vec::new(),
            pieces,
            part_of_link,
            carrier,
            joint_part,
            cut_at_joint,
            source_body,
            source_placement,
            source_path: (1..bodies)
                .filter(|&b| model.supports(b, source_body))
                .collect(),
            fixed_gravity,
        };
        layout.add_sensors(model, p, &cuts)?;
        let stand = fixed_gravity.map(|_| layout.part_of_link[source_link]);
        layout.add_parts(model, &cuts, stand);
        Ok(layout)
    }

    fn add_sensors(
        &mut self,
        model: &Model,
        p: &WholeBodyParameters,
        cuts: &[(usize, usize)],
    ) -> Result<(), WholeBodyError> {
        let frames = model.frames();
        for &(cut, input) in cuts {
            let parameters = &p.ft_sensors[input];
            let owner = format!("F/T sensor `{}`", parameters.name);
            let (body, placement) = resolve(model, &owner, &parameters.frame)?;
            let parent = frames[cut].parent.unwrap_or(0);
            let before = self.part_of_link[parent];
            let before_piece = piece_of(&self.pieces, frames[parent].body, before);
            let mut carriers = Vec::new();
            if !frames[cut].rigid {
                carriers.push(frames[cut].body);
            }
            carriers.extend(self.path(before_piece));
            self.sensors.push(Sensor {
                input,
                body,
                placement,
                before,
                before_piece,
                carriers,
            });
        }
        Ok(())
    }

    fn add_parts(&mut self, model: &Model, cuts: &[(usize, usize)], stand: Option<usize>) {
        let frames = model.frames();
        for part in 0..=cuts.len() {
            let root = frames.iter().position(|f| f.parent.is_none()).unwrap_or(0);
            let first_link = part.checked_sub(1).map_or(root, |s| cuts[s].0);
            let body = frames[first_link].body;
            let inner = part.checked_sub(1).map(|s| (s, -1.0));
            let outer = (self.sensors.iter().enumerate())
                .filter(|(_, s)| s.before == part)
                .map(|(s, _)| (s, 1.0));
            self.parts.push(Part {
                root_piece: piece_of(&self.pieces, body, part),
                first_link,
                placement: frames[first_link].placement,
                boundary: inner.into_iter().chain(outer).collect(),
                joints: (1..self.joint_part.len())
                    .filter(|&b| self.joint_part[b] == part)
                    .collect(),
                fixed_by_stand: stand == Some(part),
            });
        }
    }

    /// Bodies whose joints of the same part carry a piece, outermost first.
    pub(crate) fn path(&self, mut piece: usize) -> Vec<usize> {
        let part = self.pieces[piece].part;
        let mut path = Vec::new();
        // Only a piece that hangs on a joint of its own part has one before it.
        while piece > 0 && piece < self.carrier.len() && self.joint_part[piece] == part {
            path.push(piece);
            piece = self.carrier[piece];
        }
        path
    }

    /// The piece that holds a link.
    pub(crate) fn piece_of_link(&self, model: &Model, link: usize) -> usize {
        piece_of(
            &self.pieces,
            model.frames()[link].body,
            self.part_of_link[link],
        )
    }

    /// A part in words: its sensors and links.
    pub(crate) fn describe(&self, model: &Model, p: &WholeBodyParameters, part: usize) -> String {
        const SHOWN: usize = 6;
        let frames = model.frames();
        let links: Vec<String> = (0..frames.len())
            .filter(|&link| self.part_of_link[link] == part)
            .map(|link| format!("`{}`", frames[link].name))
            .collect();
        let more = match links.len().saturating_sub(SHOWN) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let name = |s: usize| format!("`{}`", p.ft_sensors[self.sensors[s].input].name);
        let list = links[..links.len().min(SHOWN)].join(", ") + &more;
        let outer: Vec<String> = (self.parts[part].boundary.iter())
            .filter(|(_, sign)| *sign > 0.0)
            .map(|(s, _)| name(*s))
            .collect();
        let before = match outer.len() {
            0 => String::new(),
            _ => format!(" before F/T sensor {}", outer.join(", ")),
        };
        match part.checked_sub(1) {
            None if before.is_empty() => format!("the whole robot (links {list})"),
            None => format!("the part with the root,{before} (links {list})"),
            Some(s) => format!(
                "the part beyond F/T sensor {}{before} (links {list})",
                name(s)
            ),
        }
    }
}

/// The part of a link: 0 before every cut, else one more than the index of the nearest of `cuts`
/// (links just beyond sensors) towards the root. None for a link that the model lacks.
#[must_use]
pub fn part_of_link(model: &Model, cuts: &[&str], link: &str) -> Option<usize> {
    let cuts = cuts.iter().enumerate();
    let cuts: Vec<(usize, usize)> = cuts
        .filter_map(|(s, cut)| Some((model.frame_index(cut)?, s)))
        .collect();
    let place = part_of(model, &cuts, model.frame_index(link)?);
    Some(place.checked_sub(1).map_or(0, |i| cuts[i].1 + 1))
}

/// Index of a link; `owner`: the part of the input that names it.
pub(crate) fn find(model: &Model, owner: &str, link: &str) -> Result<usize, WholeBodyError> {
    let unknown = || WholeBodyError::UnknownLink(owner.to_owned(), link.to_owned());
    model.frame_index(link).ok_or_else(unknown)
}

/// The body that a place is fixed to, and the place's frame in it.
fn resolve(model: &Model, owner: &str, place: &Place) -> Result<(usize, Se3), WholeBodyError> {
    let link = &model.frames()[find(model, owner, &place.link)?];
    let numbers = place.placement.translation.iter();
    let mut numbers = numbers.chain(place.placement.rotation.iter());
    if !numbers.all(|x| x.is_finite()) {
        let owner = format!("{owner}: placement on link `{}`", place.link);
        let problem = Problem::new(format!("{owner} is not finite"), "finite numbers");
        return Err(WholeBodyError::BadNumber(problem));
    }
    Ok((link.body, link.placement.compose(&place.placement)))
}

fn joints(model: &Model, p: &WholeBodyParameters) -> Result<Vec<usize>, WholeBodyError> {
    let index = |name: &String| {
        let unknown = || WholeBodyError::UnknownJoint(name.clone());
        model.joint_index(name).ok_or_else(unknown)
    };
    let indices: Vec<usize> = p.joints.iter().map(index).collect::<Result<_, _>>()?;
    for (i, name) in model.joint_names().enumerate() {
        if indices.iter().filter(|&&index| index == i).count() != 1 {
            return Err(WholeBodyError::JointNotNamedOnce(name.to_owned()));
        }
    }
    sigmas(p)?;
    Ok(indices)
}

fn sigmas(p: &WholeBodyParameters) -> Result<(), WholeBodyError> {
    let check = |owner: String, sigma: Option<&f64>| match sigma {
        Some(s) if s.is_finite() && *s >= 0.0 => Ok(()),
        _ => Err(WholeBodyError::BadNumber(Problem::new(
            format!("standard deviation of {owner} is not allowed"),
            Allowed::NonNegative.to_string(),
        ))),
    };
    for (i, name) in p.joints.iter().enumerate() {
        let owner = format!("the acceleration of joint `{name}`");
        check(owner, p.sigma_ddq.get(i))?;
    }
    for s in &p.ft_sensors {
        check(format!("F/T sensor `{}`", s.name), Some(&s.sigma_force))?;
        check(format!("F/T sensor `{}`", s.name), Some(&s.sigma_torque))?;
        for lasting in [s.lasting.force, s.lasting.torque, s.lasting.share] {
            check(format!("F/T sensor `{}`", s.name), Some(&lasting))?;
        }
    }
    match &p.source {
        MotionSource::Imu(imu) => {
            check("the accelerometer".into(), Some(&imu.sigma_accelerometer))?;
            check("the accelerometer".into(), Some(&imu.lasting_accelerometer))?;
            let sigma = &imu.sigma_angular_acceleration;
            check("the angular acceleration".into(), Some(sigma))?;
        }
        MotionSource::Fixed { gravity, .. } => {
            if !gravity.iter().all(|x| x.is_finite()) {
                let problem = Problem::new("gravity is not finite", "three finite numbers");
                return Err(WholeBodyError::BadNumber(problem));
            }
        }
    }
    check("the model's masses".into(), Some(&p.sigma_model))
}

/// Each sensor's first link beyond and its index as given, in the order of the links.
fn cuts(
    model: &Model,
    sensors: &[FtSensorParameters],
) -> Result<Vec<(usize, usize)>, WholeBodyError> {
    let mut cuts: Vec<(usize, usize)> = Vec::new();
    for (i, s) in sensors.iter().enumerate() {
        if sensors[..i].iter().any(|other| other.name == s.name) {
            return Err(WholeBodyError::SensorNamedTwice(s.name.clone()));
        }
        let link = find(model, &format!("F/T sensor `{}`", s.name), &s.cut)?;
        if model.frames()[link].parent.is_none() {
            return Err(WholeBodyError::SensorOnRoot(s.name.clone()));
        }
        if let Some((_, j)) = cuts.iter().find(|(other, _)| *other == link) {
            let other = sensors[*j].name.clone();
            return Err(WholeBodyError::SameCut(
                other,
                s.name.clone(),
                s.cut.clone(),
            ));
        }
        cuts.push((link, i));
    }
    cuts.sort_unstable();
    Ok(cuts)
}

/// The part of a link: 0 or one more than the index of the nearest cut towards the root.
fn part_of(model: &Model, cuts: &[(usize, usize)], link: usize) -> usize {
    let towards_root = std::iter::successors(Some(link), |&l| model.frames()[l].parent);
    let cut = |l: usize| cuts.iter().position(|(cut, _)| *cut == l);
    towards_root.into_iter().find_map(cut).map_or(0, |s| s + 1)
}

fn pieces(model: &Model, part_of_link: &[usize]) -> Vec<Piece> {
    let piece = |body, part| Piece {
        body,
        part,
        inertia: Inertia::zero(),
    };
    let mut pieces: Vec<Piece> = (0..model.bodies().len())
        .map(|body| {
            let holds = |(_, f): &(usize, &dynamics::Frame)| {
                f.body == body && (!f.rigid || f.parent.is_none())
            };
            let link = model.frames().iter().enumerate().find(holds);
            piece(body, link.map_or(0, |(link, _)| part_of_link[link]))
        })
        .collect();
    for (link, &part) in model.frames().iter().zip(part_of_link) {
        let known = |p: &Piece| p.body == link.body && p.part == part;
        let index = pieces.iter().position(known).unwrap_or_else(|| {
            pieces.push(piece(link.body, part));
            pieces.len() - 1
        });
        pieces[index].inertia += link.inertia.transformed(&link.placement);
    }
    pieces
}

fn piece_of(pieces: &[Piece], body: usize, part: usize) -> usize {
    let is = |p: &Piece| p.body == body && p.part == part;
    pieces.iter().position(is).unwrap_or(0)
}
