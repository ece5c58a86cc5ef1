//! Times whole updates of the whole-body estimator: `whole-body-bench URDF SENSORS.toml ROOT_LINK`
//! prints one line of numbers: medians in ns of an update with one full wrench on every part, of one
//! with a pure force at every sensor's end, and of one with the latter weighted by covariances.
//!
//! An update is all there is: kinematics, every part's contacts, every joint's torque, and the
//! standard deviations of all of it.

use dynamics::{Base, ImuMotion, Model, Random, Se3};
use robot_state::Wrench;
use serde::Deserialize;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;
use whole_body::{
    ContactKind, ContactParameters, FtSensorParameters, Hypothesis, ImuParameters, MotionSource,
    Place, Residual, Weighting, WholeBody, WholeBodyInput, WholeBodyParameters,
};

const STATES: usize = 64;
const ROUNDS: usize = 2000;

/// A robot's sensors: those keys of the sensors' file (docs/whole-body-files.md) that matter here.
#[derive(Deserialize)]
struct Sensors {
    sigma_ddq_rad_per_s2: f64,
    imu: Imu,
    ft_sensor: Vec<FtSensor>,
}

#[derive(Deserialize)]
struct Imu {
    frame: String,
    sigma_m_per_s2: f64,
}

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct FtSensor {
    name: String,
    frame: String,
    sigma_N: f64,
    sigma_Nm: f64,
}

struct State {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    ft: Vec<Wrench>,
    imu: ImuMotion,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [urdf, sensors, root] = arguments.as_slice() else {
        eprintln!("usage: whole-body-bench URDF SENSORS.toml ROOT_LINK");
        return ExitCode::from(2);
    };
    match run(urdf, sensors, root) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("whole-body-bench: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(urdf: &str, sensors: &str, root: &str) -> Result<String, String> {
    let read = |path: &str| std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"));
    let model = Model::from_urdf(&read(urdf)?, urdf, Base::Floating).map_err(|e| e.to_string())?;
    let file: Sensors = toml::from_str(&read(sensors)?).map_err(|e| format!("{sensors}: {e}"))?;
    let joints: Vec<String> = model.joint_names().map(Into::into).collect();
    let contacts = |kind: ContactKind| {
        let beyond = file.ft_sensor.iter().map(|s| (s.frame.clone(), kind));
        let all = std::iter::once((root.to_owned(), ContactKind::FullWrench)).chain(beyond);
        let contacts = all.map(|(link, kind)| ContactParameters {
            link,
            point: [0.0; 3].into(),
            kind,
        });
        Hypothesis {
            name: "bench".into(),
            contacts: contacts.collect(),
        }
    };
    let mut line = format!("{}", joints.len());
    for (kind, weighting) in [
        (ContactKind::FullWrench, Weighting::Unit),
        (ContactKind::PureForce, Weighting::Unit),
        (ContactKind::PureForce, Weighting::Expected),
    ] {
        let parameters = parameters(&file, &joints, contacts(kind), weighting);
        let whole_body = WholeBody::new(&model, &parameters).map_err(|e| e.to_string())?;
        let ft = parameters.ft_sensors.len();
        line += &format!(" {:.0}", median(whole_body, &states(&model, ft)));
    }
    Ok(line)
}

fn parameters(
    file: &Sensors,
    joints: &[String],
    contacts: Hypothesis,
    weighting: Weighting,
) -> WholeBodyParameters {
    let place = |link: &str| Place {
        link: link.to_owned(),
        placement: Se3::identity(),
    };
    let ft_sensor = |s: &FtSensor| FtSensorParameters {
        name: s.name.clone(),
        cut: s.frame.clone(),
        frame: place(&s.frame),
        sigma_force: s.sigma_N,
        sigma_torque: s.sigma_Nm,
        lasting: whole_body::LastingErrors::default(),
    };
    WholeBodyParameters {
        joints: joints.to_vec(),
        sigma_ddq: vec![file.sigma_ddq_rad_per_s2; joints.len()],
        ft_sensors: file.ft_sensor.iter().map(ft_sensor).collect(),
        source: MotionSource::Imu(ImuParameters {
            frame: place(&file.imu.frame),
            sigma_accelerometer: file.imu.sigma_m_per_s2,
            lasting_accelerometer: 0.0,
            sigma_angular_acceleration: 0.0,
        }),
        hypotheses: vec![contacts],
        weighting,
        residual: Residual::Stays,
        sigma_model: 0.0,
    }
}

fn states(model: &Model, sensors: usize) -> Vec<State> {
    let mut random = Random::new(1);
    let n = model.joint_count();
    let mut three = {
        let mut random = Random::new(2);
        move |size: f64| [(); 3].map(|()| random.uniform(-size, size))
    };
    let mut state = || State {
        q: random.vector(n, 2.0),
        dq: random.vector(n, 2.0),
        ddq: random.vector(n, 5.0),
        ft: (0..sensors)
            .map(|_| Wrench {
                force: three(100.0),
                torque: three(10.0),
            })
            .collect(),
        imu: ImuMotion {
            angular_velocity: three(1.0).into(),
            angular_acceleration: three(5.0).into(),
            proper_acceleration: three(10.0).into(),
        },
    };
    (0..STATES).map(|_| state()).collect()
}

/// Median over rounds of the mean time of an update, ns.
fn median(mut whole_body: WholeBody, states: &[State]) -> f64 {
    let mut times = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let start = Instant::now();
        for s in states {
            let estimate = whole_body.update(black_box(&WholeBodyInput {
                q: &s.q,
                dq: &s.dq,
                ddq: &s.ddq,
                ft: &s.ft,
                imu: s.imu,
            }));
            black_box(estimate);
        }
        times.push(start.elapsed().as_nanos() as f64 / states.len() as f64);
    }
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}
