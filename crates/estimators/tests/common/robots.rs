//! Random robots with F/T sensors, and scenes on them whose torques are known.

use dynamics::{
    Base, Data, Force, ImuMotion, Model, Motion, ReferenceFrame, forward_kinematics_acceleration,
    frame_classical_acceleration, frame_placement, frame_velocity, rnea,
};
use estimators::whole_body::{
    FtSensorParameters, ImuParameters, WholeBodyInput, WholeBodyParameters,
};
use nalgebra::Vector3;
use robot_state::Wrench;

/// Splitmix64.
#[derive(Clone)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }
    /// Between -1 and 1.
    pub(crate) fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }
    fn three(&mut self) -> [f64; 3] {
        [(); 3].map(|()| self.signed())
    }
}

/// A random tree of links `link0`..; sensor `s` is the link `ft<s>` fixed to some link, which
/// carries the link `beyond<s>` and perhaps moving ones.
pub(crate) struct Robot {
    pub(crate) model: Model,
    /// The same with the sensors' fixed joints made movable: what they carry can be read there.
    pub(crate) oracle: Model,
    urdf: String,
    parameters: WholeBodyParameters,
}

fn link(name: &str, random: &mut Random) -> String {
    let [x, y, z] = random.three().map(|c| 0.1 * c);
    let mass = 2.0 + random.signed();
    format!(
        "<link name='{name}'><inertial><origin xyz='{x} {y} {z}' rpy='{x} {z} {y}'/>\
         <mass value='{mass}'/><inertia ixx='0.03' iyy='0.04' izz='0.05' ixy='0.001' \
         ixz='-0.002' iyz='0.003'/></inertial></link>"
    )
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, random: &mut Random) -> String {
    let [x, y, z] = random.three().map(|c| 0.3 * c);
    let [r, p, w] = random.three();
    let [a, b, c] = random.three();
    format!(
        "<joint name='{name}' type='{kind}'><origin xyz='{x} {y} {z}' rpy='{r} {p} {w}'/>\
         <parent link='{parent}'/><child link='{child}'/><axis xyz='{a} {b} {c}'/>\
         <limit lower='-9' upper='9' velocity='9' effort='9'/></joint>"
    )
}

impl Robot {
    pub(crate) fn random(seed: u64, base: Base) -> Self {
        let mut random = Random(seed);
        let mut text = link("link0", &mut random);
        // Links that carry more, with the sensor they lie beyond.
        let mut carriers: Vec<(String, Option<usize>)> = vec![("link0".into(), None)];
        let mut sensors: Vec<(usize, Option<usize>)> = Vec::new();
        let (joints, sensor_count) = (3 + random.below(7), 1 + random.below(4));
        for i in 1..=joints {
            let (parent, beyond) = carriers[random.below(carriers.len())].clone();
            let name = format!("link{i}");
            let kind = if random.below(5) == 0 {
                "prismatic"
            } else {
                "revolute"
            };
            text += &link(&name, &mut random);
            text += &joint(&format!("joint{i}"), kind, &parent, &name, &mut random);
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
                    &mut random,
                );
                text += &link(&format!("beyond{s}"), &mut random);
                let names = (format!("ft{s}"), format!("beyond{s}"));
                text += &joint(&format!("tip{s}"), "fixed", &names.0, &names.1, &mut random);
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
        let links_of = |s: Option<usize>, random: &mut Random| {
            let own: Vec<_> = carriers.iter().filter(|(_, beyond)| *beyond == s).collect();
            own[random.below(own.len())].0.clone()
        };
        let unknown = match base {
            Base::Fixed => "link0".into(),
            Base::Floating => links_of(None, &mut random),
        };
        let ft_sensors = (0..sensors.len())
            .map(|s| FtSensorParameters {
                name: format!("s{s}"),
                frame: format!("ft{s}"),
                contact_link: (random.below(2) == 0).then(|| links_of(Some(s), &mut random)),
                sigma_force: 0.3,
                sigma_torque: 0.02,
            })
            .collect();
        let mut names: Vec<String> = model.joint_names().map(Into::into).collect();
        names.rotate_left(random.below(joints));
        let parameters = WholeBodyParameters {
            sigma_ddq: (0..joints).map(|i| 0.1 + 0.01 * i as f64).collect(),
            joints: names,
            ft_sensors,
            imu: Some(ImuParameters {
                frame: carriers[random.below(carriers.len())].0.clone(),
                sigma_accelerometer: 0.05,
            }),
            unknown_wrench_link: Some(unknown),
        };
        Self {
            model,
            oracle,
            urdf,
            parameters,
        }
    }

    pub(crate) fn parameters(&self) -> WholeBodyParameters {
        self.parameters.clone()
    }

    pub(crate) fn links(&self) -> Vec<String> {
        self.model.frames().iter().map(|f| f.name.clone()).collect()
    }

    pub(crate) fn make_floating(&mut self) {
        self.model = Model::from_urdf(&self.urdf, "random.urdf", Base::Floating).unwrap();
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
    pub(crate) unknown: Wrench,
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

impl Scene {
    pub(crate) fn random(robot: &Robot, seed: u64) -> Self {
        let mut random = Random(seed);
        let (oracle, p) = (&robot.oracle, &robot.parameters);
        let (bv, bq) = oracle.base_size();
        let mut q = vec![0.0; oracle.nq()];
        let mut v = vec![0.0; oracle.nv()];
        let mut a = vec![0.0; oracle.nv()];
        if bq > 0 {
            q[..7].iter_mut().for_each(|x| *x = random.signed());
            let norm = q[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
            q[3..7].iter_mut().for_each(|x| *x /= norm);
            v[..6]
                .iter_mut()
                .chain(&mut a[..6])
                .for_each(|x| *x = random.signed());
        }
        let index = |name: &String| oracle.joint_index(name).unwrap();
        for j in p.joints.iter().map(index) {
            (q[bq + j], v[bv + j], a[bv + j]) = (
                2.0 * random.signed(),
                random.signed(),
                3.0 * random.signed(),
            );
        }
        let mut data = Data::new(oracle);
        forward_kinematics_acceleration(oracle, &mut data, &q, &v, &a);
        let frame = |name: &str| oracle.frame_index(name).unwrap();
        let placement = |name: &str| frame_placement(oracle, &data, frame(name));
        // Contact wrenches at the sensors' frames, acting on the contact links.
        let mut f_ext = vec![Force::zero(); oracle.bodies().len()];
        let mut contact = Vec::new();
        for s in &p.ft_sensors {
            let f = Force::from_array([(); 6].map(|()| 10.0 * random.signed()));
            let body = oracle.frames()[frame(s.contact_link.as_ref().unwrap_or(&s.frame))].body;
            let to_body = data.placements()[body]
                .inverse()
                .compose(&placement(&s.frame));
            f_ext[body] += to_body.act_force(f);
            contact.push(wrench(f));
        }
        // The unknown wrench is what the base still needs.
        let unknown_link = p.unknown_wrench_link.as_deref().unwrap_or("link0");
        let unknown_body = oracle.frames()[frame(unknown_link)].body;
        let link_in_world = placement(unknown_link);
        let root = held(oracle, &data, &f_ext, 0);
        let unknown = link_in_world.inverse_act_force(root);
        let to_body = data.placements()[unknown_body]
            .inverse()
            .compose(&link_in_world);
        f_ext[unknown_body] += to_body.act_force(unknown);
        let torques = rnea(oracle, &mut Data::new(oracle), &q, &v, &a, Some(&f_ext)).to_vec();
        let read = |sensor: &FtSensorParameters| {
            let body = oracle.frames()[frame(&sensor.frame)].body;
            let on_beyond = held(oracle, &data, &f_ext, body);
            wrench(-data.placements()[body].inverse_act_force(on_beyond))
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
            unknown: wrench(unknown),
            full: [q, v, a],
        };
        scene.with_imu_on(robot, &p.imu.as_ref().unwrap().frame)
    }

    /// The same scene as an IMU on that link feels it.
    pub(crate) fn with_imu_on(&self, robot: &Robot, link: &str) -> Self {
        let oracle = &robot.oracle;
        let mut data = Data::new(oracle);
        let [q, v, a] = &self.full;
        forward_kinematics_acceleration(oracle, &mut data, q, v, a);
        let frame = oracle.frame_index(link).unwrap();
        let local = ReferenceFrame::Local;
        let acceleration = frame_classical_acceleration(oracle, &data, frame, local);
        let rotation = frame_placement(oracle, &data, frame).rotation;
        let imu = ImuMotion {
            angular_velocity: frame_velocity(oracle, &data, frame, local).angular,
            angular_acceleration: acceleration.angular,
            proper_acceleration: acceleration.linear - rotation.tr_mul(&oracle.gravity()),
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
