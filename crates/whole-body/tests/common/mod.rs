//! Random robots with F/T sensors, and scenes on them whose torques are known.

use dynamics::{
    Base, Data, Force, ImuMotion, Model, Motion, Se3, forward_kinematics_acceleration,
    frame_placement, rnea,
};
use nalgebra::{DMatrix, Vector3};
use robot_state::Wrench;
use test_support::Random;
use whole_body::{
    ContactKind, ContactParameters, FtSensorParameters, Hypothesis, ImuParameters, LastingErrors,
    MotionSource, Place, Residual, Weighting, WholeBodyInput, WholeBodyParameters,
};

/// A random tree of links `link0`..; sensor `s` is the link `ft<s>` fixed to some link, which
/// carries the link `beyond<s>` and perhaps moving ones.
pub(crate) struct Robot {
    pub(crate) model: Model,
    /// The same with the sensors' fixed joints made movable: the oracle of their readings.
    pub(crate) oracle: Model,
    parameters: WholeBodyParameters,
    urdf: String,
}

fn link(name: &str, random: &mut Random) -> String {
    let [x, y, z] = random.array().map(|c| 0.1 * c);
    let mass = 2.0 + random.symmetric();
    format!(
        "<link name='{name}'><inertial><origin xyz='{x} {y} {z}' rpy='{x} {z} {y}'/>\
         <mass value='{mass}'/><inertia ixx='0.03' iyy='0.04' izz='0.05' ixy='0.001' \
         ixz='-0.002' iyz='0.003'/></inertial></link>"
    )
}

fn joint(
    name: &str,
    kind: &str,
    parent: &str,
    child: &str,
    mimic: &str,
    random: &mut Random,
) -> String {
    let [x, y, z] = random.array().map(|c| 0.3 * c);
    let [r, p, w] = random.array();
    let [a, b, c] = random.array();
    format!(
        "<joint name='{name}' type='{kind}'><origin xyz='{x} {y} {z}' rpy='{r} {p} {w}'/>\
         <parent link='{parent}'/><child link='{child}'/><axis xyz='{a} {b} {c}'/>\
         <limit lower='-9' upper='9' velocity='9' effort='9'/>{mimic}</joint>"
    )
}

impl Robot {
    pub(crate) fn random(seed: u64) -> Self {
        let base = Base::Floating;
        let mut random = Random::new(seed);
        let mut text = link("link0", &mut random);
        // Links that carry more, with the sensor they lie beyond.
        let mut carriers: Vec<(String, Option<usize>)> = vec![("link0".into(), None)];
        let mut sensors: Vec<(usize, Option<usize>)> = Vec::new();
        let (joints, sensor_count) = (3 + random.below(7), 1 + random.below(4));
        // Every fourth joint but the first three follows one of those.
        let mut random_mimic = Random::new(seed ^ 0x6d69);
        let mut mimic = |i: usize| {
            if i > 3 && random_mimic.below(4) == 0 {
                let (driver, ratio) = (1 + random_mimic.below(3), 2.0 * random_mimic.symmetric());
                format!("<mimic joint='joint{driver}' multiplier='{ratio}' offset='0.2'/>")
            } else {
                String::new()
            }
        };
        for i in 1..=joints {
            let (parent, beyond) = carriers[random.below(carriers.len())].clone();
            let name = format!("link{i}");
            let kind = if random.below(5) == 0 {
                "prismatic"
            } else {
                "revolute"
            };
            text += &link(&name, &mut random);
            let follows = mimic(i);
            let own = format!("joint{i}");
            text += &joint(&own, kind, &parent, &name, &follows, &mut random);
            carriers.push((name, beyond));
            if sensors.len() < sensor_count && (random.below(2) == 0 || i == joints) {
                let s = sensors.len();
                let (parent, beyond) = carriers[random.below(carriers.len())].clone();
                text += &link(&format!("ft{s}"), &mut random);
                text += &joint(
                    &format!("sensor{s}"),
                    "fixed",
                    &parent,
                    &format!("ft{s}"),
                    "",
                    &mut random,
                );
                text += &link(&format!("beyond{s}"), &mut random);
                let names = (format!("ft{s}"), format!("beyond{s}"));
                text += &joint(
                    &format!("tip{s}"),
                    "fixed",
                    &names.0,
                    &names.1,
                    "",
                    &mut random,
                );
                carriers.push((names.1, Some(s)));
                sensors.push((s, beyond));
            }
        }
        let urdf = format!("<robot name='random'>{text}</robot>");
        let model = Model::from_urdf(&urdf, "random.urdf", base).unwrap();
        let mut movable = urdf.clone();
        for s in 0..sensors.len() {
            let fixed = format!("<joint name='sensor{s}' type='fixed'>");
            movable = movable.replace(&fixed, &format!("<joint name='sensor{s}' type='revolute'>"));
        }
        let oracle = Model::from_urdf(&movable, "random.urdf", base).unwrap();
        // Links directly beyond sensor `s` and before any other, or before every sensor.
        let links_of = |s: Option<usize>| {
            let own = carriers.iter().filter(|(_, beyond)| *beyond == s);
            own.map(|(name, _)| name.clone()).collect::<Vec<_>>()
        };
        let mut contacts = Vec::new();
        for s in std::iter::once(None).chain((0..sensors.len()).map(Some)) {
            let links = links_of(s);
            let one = |random: &mut Random, kind| ContactParameters {
                link: links[random.below(links.len())].clone(),
                point: Vector3::from(random.array()) * 0.1,
                kind,
            };
            let direction =
                |random: &mut Random| ContactKind::KnownDirection(Vector3::from(random.array()));
            // The part with the root needs all six: nothing else holds the robot.
            let choice = if s.is_none() {
                random.below(2)
            } else {
                random.below(6)
            };
            match choice {
                0 => contacts.push(one(&mut random, ContactKind::FullWrench)),
                1 => {
                    contacts.push(one(&mut random, ContactKind::PureForce));
                    for _ in 0..3 {
                        let kind = direction(&mut random);
                        contacts.push(one(&mut random, kind));
                    }
                }
                2 => contacts.push(one(&mut random, ContactKind::PureForce)),
                3 => {
                    for _ in 0..1 + random.below(4) {
                        let kind = direction(&mut random);
                        contacts.push(one(&mut random, kind));
                    }
                }
                4 => {
                    contacts.push(one(&mut random, ContactKind::PureForce));
                    let kind = direction(&mut random);
                    contacts.push(one(&mut random, kind));
                }
                _ => contacts.push(one(&mut random, ContactKind::Nothing)),
            }
        }
        let ft_sensors = (0..sensors.len())
            .map(|s| FtSensorParameters {
                name: format!("s{s}"),
                cut: format!("ft{s}"),
                frame: Place {
                    link: format!("ft{s}"),
                    placement: Se3::from_xyz_rpy(random.array(), random.array()),
                },
                sigma_force: 0.3,
                sigma_torque: 0.02,
                lasting: LastingErrors::default(),
            })
            .collect();
        let mut names: Vec<String> = model.joint_names().map(Into::into).collect();
        let turn = random.below(joints) % names.len();
        names.rotate_left(turn);
        let parameters = WholeBodyParameters {
            sigma_ddq: (0..names.len()).map(|i| 0.1 + 0.01 * i as f64).collect(),
            joints: names,
            ft_sensors,
            source: MotionSource::Imu(ImuParameters {
                frame: Place {
                    link: carriers[random.below(carriers.len())].0.clone(),
                    placement: Se3::from_xyz_rpy(random.array(), random.array()),
                },
                sigma_accelerometer: 0.05,
                lasting_accelerometer: 0.0,
                sigma_angular_acceleration: 0.1,
            }),
            hypotheses: vec![Hypothesis {
                name: "random".into(),
                contacts,
            }],
            weighting: Weighting::Unit,
            residual: Residual::Stays,
            sigma_model: 0.0,
        };
        Self {
            model,
            oracle,
            parameters,
            urdf,
        }
    }

    /// The model with twice the mass of a part's links (0: before every sensor; else beyond one).
    pub(crate) fn with_doubled(&self, part: usize) -> Model {
        let sensors = self.parameters.ft_sensors.iter();
        let cuts: Vec<&str> = sensors.map(|s| s.cut.as_str()).collect();
        let links = self.urdf.split_inclusive("</link>");
        let doubled = |text: &str| {
            let name = text.split_once("<link name='")?.1.split_once('\'')?.0;
            if whole_body::part_of_link(&self.model, &cuts, name)? != part {
                return None;
            }
            let mut doubled = text.to_owned();
            for attribute in ["mass value", "ixx", "iyy", "izz", "ixy", "ixz", "iyz"] {
                let (before, number) = doubled.split_once(&format!("{attribute}='"))?;
                let (number, after) = number.split_once('\'')?;
                let number = 2.0 * number.parse::<f64>().ok()?;
                doubled = format!("{before}{attribute}='{number}'{after}");
            }
            Some(doubled)
        };
        let text: String = links
            .map(|text| doubled(text).unwrap_or_else(|| text.to_owned()))
            .collect();
        Model::from_urdf(&text, "random.urdf", Base::Floating).unwrap()
    }

    pub(crate) fn parameters(&self) -> WholeBodyParameters {
        self.parameters.clone()
    }

    /// Indices of the contacts before every sensor.
    fn contacts_of_root(&self) -> Vec<usize> {
        let contacts = &self.parameters.hypotheses[0].contacts;
        let cut = |link: &str| self.parameters.ft_sensors.iter().any(|s| s.cut == link);
        let of_root = |c: &ContactParameters| {
            let frames = self.model.frames();
            let mut at = self.model.frame_index(&c.link);
            while let Some(link) = at {
                if cut(&frames[link].name) {
                    return false;
                }
                at = frames[link].parent;
            }
            true
        };
        (0..contacts.len())
            .filter(|&i| of_root(&contacts[i]))
            .collect()
    }

    pub(crate) fn links(&self) -> Vec<String> {
        self.model.frames().iter().map(|f| f.name.clone()).collect()
    }
}

/// A state of a robot with every wrench and torque in it.
#[derive(Clone)]
pub(crate) struct Scene {
    pub(crate) q: Vec<f64>,
    pub(crate) dq: Vec<f64>,
    pub(crate) ddq: Vec<f64>,
    pub(crate) ft: Vec<Wrench>,
    pub(crate) imu: ImuMotion,
    pub(crate) tau: Vec<f64>,
    pub(crate) contact: Vec<Wrench>,
    /// The oracle's full state.
    full: [Vec<f64>; 3],
}

fn wrench(f: Force) -> Wrench {
    Wrench {
        force: f.linear.into(),
        torque: f.angular.into(),
    }
}

/// Wrench that holds `body` and all that it carries, in the world's frame, by Newton and Euler.
fn held(model: &Model, data: &Data, f_ext: &[Force], body: usize) -> Force {
    let weight = Motion::new(model.gravity(), Vector3::zeros());
    let mut sum = Force::zero();
    for i in (0..model.bodies().len()).filter(|&i| model.supports(body, i)) {
        let placement = &data.placements()[i];
        let falling = data.accelerations()[i] - placement.inverse_act_motion(weight);
        let net = model.bodies()[i]
            .inertia
            .wrench(data.velocities()[i], falling);
        sum += placement.act_force(net - f_ext[i]);
    }
    sum
}

/// A contact's wrench at its point, from the values of its unknowns.
fn value(c: &ContactParameters, x: [f64; 6]) -> Force {
    let three = |k: usize| Vector3::new(x[k], x[k + 1], x[k + 2]);
    match c.kind {
        ContactKind::FullWrench => Force::new(three(0), three(3)),
        ContactKind::PureForce => Force::new(three(0), Vector3::zeros()),
        ContactKind::KnownDirection(d) => Force::new(d.normalize() * x[0], Vector3::zeros()),
        ContactKind::Nothing => Force::zero(),
    }
}

/// A contact's frame in the world.
fn point(model: &Model, data: &Data, c: &ContactParameters) -> Se3 {
    let link = frame_placement(model, data, model.frame_index(&c.link).unwrap());
    Se3::new(link.rotation, link.act_point(c.point))
}

/// Adds a contact's wrench to those of its body.
fn push(model: &Model, f_ext: &mut [Force], c: &ContactParameters, f: Force) {
    let link = &model.frames()[model.frame_index(&c.link).unwrap()];
    let at = Se3::new(Se3::identity().rotation, c.point);
    f_ext[link.body] += link.placement.compose(&at).act_force(f);
}

impl Scene {
    pub(crate) fn random(robot: &Robot, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let (oracle, p) = (&robot.oracle, &robot.parameters);
        let (bv, bq) = oracle.base_size();
        let mut q = vec![0.0; oracle.nq()];
        let mut v = vec![0.0; oracle.nv()];
        let mut a = vec![0.0; oracle.nv()];
        if bq > 0 {
            q[..7].iter_mut().for_each(|x| *x = random.symmetric());
            let norm = q[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
            q[3..7].iter_mut().for_each(|x| *x /= norm);
            v[..6]
                .iter_mut()
                .chain(&mut a[..6])
                .for_each(|x| *x = random.symmetric());
        }
        let index = |name: &String| oracle.joint_index(name).unwrap();
        for j in p.joints.iter().map(index) {
            (q[bq + j], v[bv + j], a[bv + j]) = (
                2.0 * random.symmetric(),
                random.symmetric(),
                3.0 * random.symmetric(),
            );
        }
        let mut data = Data::new(oracle);
        forward_kinematics_acceleration(oracle, &mut data, &q, &v, &a);
        let frame = |name: &str| oracle.frame_index(name).unwrap();
        let placement = |name: &str| frame_placement(oracle, &data, frame(name));
        // Any values of the unknowns; those of the root's part carry the rest.
        let mut f_ext = vec![Force::zero(); oracle.bodies().len()];
        let mut contact = Vec::new();
        let contacts = &p.hypotheses[0].contacts;
        let root_part = robot.contacts_of_root();
        for (i, c) in contacts.iter().enumerate() {
            let f = value(c, std::array::from_fn(|_| 10.0 * random.symmetric()));
            if !root_part.contains(&i) {
                push(oracle, &mut f_ext, c, f);
            }
            contact.push(wrench(f));
        }
        let rest = held(oracle, &data, &f_ext, 0);
        let mut columns = DMatrix::zeros(6, 6);
        let mut units = Vec::new();
        for &i in &root_part {
            for k in 0..contacts[i].kind.unknowns() {
                let unit = value(
                    &contacts[i],
                    std::array::from_fn(|j| f64::from(u8::from(j == k))),
                );
                let at = point(oracle, &data, &contacts[i]);
                let column = at.act_force(unit).to_vector();
                columns.set_column(units.len(), &column);
                units.push((i, unit));
            }
        }
        let x = columns.lu().solve(&rest.to_vector()).unwrap();
        for &i in &root_part {
            let mut f = Force::zero();
            for ((j, unit), x) in units.iter().zip(x.iter()) {
                if *j == i {
                    f += *unit * *x;
                }
            }
            push(oracle, &mut f_ext, &contacts[i], f);
            contact[i] = wrench(f);
        }
        let torques = rnea(oracle, &mut Data::new(oracle), &q, &v, &a, Some(&f_ext)).to_vec();
        let read = |sensor: &FtSensorParameters| {
            let body = oracle.frames()[frame(&sensor.cut)].body;
            let on_beyond = held(oracle, &data, &f_ext, body);
            let at = placement(&sensor.frame.link).compose(&sensor.frame.placement);
            wrench(-at.inverse_act_force(on_beyond))
        };
        let pick = |x: &[f64], base: usize| {
            p.joints
                .iter()
                .map(|j| x[base + index(j)])
                .collect::<Vec<f64>>()
        };
        let scene = Self {
            q: pick(&q, bq),
            dq: pick(&v, bv),
            ddq: pick(&a, bv),
            ft: p.ft_sensors.iter().map(read).collect(),
            imu: ImuMotion {
                angular_velocity: Vector3::zeros(),
                angular_acceleration: Vector3::zeros(),
                proper_acceleration: Vector3::zeros(),
            },
            tau: pick(&torques, bv),
            contact,
            full: [q, v, a],
        };
        match &p.source {
            MotionSource::Imu(imu) => scene.with_imu_at(robot, &imu.frame),
            MotionSource::Fixed { .. } => scene,
        }
    }

    /// The same scene as an IMU at that place feels it.
    pub(crate) fn with_imu_at(&self, robot: &Robot, place: &Place) -> Self {
        let oracle = &robot.oracle;
        let mut data = Data::new(oracle);
        let [q, v, a] = &self.full;
        forward_kinematics_acceleration(oracle, &mut data, q, v, a);
        let link = &oracle.frames()[oracle.frame_index(&place.link).unwrap()];
        let in_body = link.placement.compose(&place.placement);
        let twist = in_body.inverse_act_motion(data.velocities()[link.body]);
        let acceleration = in_body.inverse_act_motion(data.accelerations()[link.body]);
        let rotation = data.placements()[link.body].rotation * in_body.rotation;
        let imu = ImuMotion {
            angular_velocity: twist.angular,
            angular_acceleration: acceleration.angular,
            proper_acceleration: acceleration.linear + twist.angular.cross(&twist.linear)
                - rotation.tr_mul(&oracle.gravity()),
        };
        Self {
            imu,
            ..self.clone()
        }
    }

    pub(crate) fn input(&self) -> WholeBodyInput<'_> {
        WholeBodyInput {
            q: &self.q,
            dq: &self.dq,
            ddq: &self.ddq,
            ft: &self.ft,
            imu: self.imu,
        }
    }
}
