//! `[[ft_sensor]]` and `[imu]` or `[[imu]]`.

use crate::general::name;
use crate::liveness;
use crate::parameters::{FtParameters, FtSensor, ImuParameters};
use crate::reader::{Allowed, Section};
use crate::sampling::{self, Sampling};
use crate::slots;
use crate::units::Quantity;
use crate::wiring::{Use, Way, Wiring};
use control::Sole;
use nalgebra::Matrix6;
use robot_state::{MAX_FT_SENSORS, MAX_FURTHER_IMUS};
use whole_body::{FtConditioning, LastingErrors};

/// Share of a force or torque by which an F/T sensor's axes err, standard deviation, per cent. Chosen on the simulated
/// robots, each of whose axes shows up to 0.2 % of the others: docs/results/fusion.md.
const READING_PER_CENT: f64 = 0.2;
const LINK: &str = "the name of a link of the URDF";

pub(crate) fn ft_sensors(
    root: &Section<'_, '_>,
    sample_period: f64,
    wiring: &mut Wiring<'_, '_>,
) -> Vec<FtParameters> {
    let mut sections = root.list("ft_sensor");
    if sections.len() > MAX_FT_SENSORS {
        let what = format!("{} F/T sensors are not allowed", sections.len());
        root.problem("ft_sensor", what, format!("at most {MAX_FT_SENSORS}"));
        sections.truncate(MAX_FT_SENSORS);
    }
    let mut sensors = Vec::<FtParameters>::new();
    for (index, mut section) in sections.into_iter().enumerate() {
        let name = name(&section, "name");
        section.which = format!(" ({name})");
        if sensors.iter().any(|other| other.sensor.name == name) {
            section.problem(
                "name",
                "a second F/T sensor has this name",
                "each sensor once",
            );
        }
        let sampling = sampling::read(&section, sample_period);
        sensors.extend(ft_sensor(
            &section,
            index,
            name,
            (sampling, sample_period),
            wiring,
        ));
        section.finish();
    }
    sensors
}

fn ft_sensor(
    section: &Section<'_, '_>,
    index: usize,
    name: String,
    (sampling, sample_period): (Sampling, f64),
    wiring: &mut Wiring<'_, '_>,
) -> Option<FtParameters> {
    let frame = section.text("frame", LINK);
    let contact_link = section.optional_text("contact_link", LINK);
    let sigma_force = section.number("sigma_N", Allowed::NonNegative);
    let sigma_torque = section.number("sigma_Nm", Allowed::NonNegative);
    let lasting = lasting(section, [sigma_force, sigma_torque]);
    let calibrated = section.has("calibration");
    let ranges = ["range_N", "range_Nm"].map(|key| {
        let range = section.optional_number(key, Allowed::Positive);
        if range.is_some() && calibrated {
            let what = "the signals before the matrix have other units";
            section.problem(key, what, "only without calibration");
        }
        range.unwrap_or(f64::INFINITY)
    });
    let conditioning = conditioning(section);
    let flat_after = liveness::flat_after(section, &sampling, sample_period);
    let bus = wiring.bus(section);
    let mut signals = Vec::new();
    for (key, first, quantity, sigma, range) in [
        ("force", 0, Quantity::Force, sigma_force, ranges[0]),
        ("torque", 3, Quantity::Torque, sigma_torque, ranges[1]),
    ] {
        section.has(key);
        if let Some(bus) = bus {
            let reaches = wiring.connect_axes(section, key, |axis| Use {
                way: Way::Receive,
                bus,
                slot: slots::ft(index, first + axis),
                // The matrix includes the signals' units.
                quantity: if calibrated {
                    Quantity::Status
                } else {
                    quantity
                },
                sign: 1.0,
                offset: 0.0,
            });
            // The noise of the signals before the matrix is not known.
            let sigma = if calibrated { 0.0 } else { sigma };
            let of_axis = |reach| liveness::signal(reach, sigma, flat_after).within(range);
            signals.extend(reaches.map(of_axis));
        }
    }
    let sole = sole(section);
    let temperature = section.optional_text("temperature", "a signal MESSAGE.signal");
    if let (Some(path), Some(bus)) = (&temperature, bus) {
        let how = Use {
            way: Way::Receive,
            bus,
            slot: slots::ft_temperature(index),
            quantity: Quantity::Temperature,
            sign: 1.0,
            offset: 0.0,
        };
        let _noted = wiring.connect(&section.path("temperature"), path, &how);
    }
    Some(FtParameters {
        sensor: FtSensor {
            name,
            frame: frame?.value.to_owned(),
            contact_link: contact_link.map(|link| link.value.to_owned()),
            sigma_force,
            sigma_torque,
            lasting,
        },
        bus: bus?,
        sampling,
        conditioning,
        signals,
        sole,
        has_temperature: temperature.is_some(),
    })
}

/// The sole by its corners; none where no corners are given.
fn sole(section: &Section<'_, '_>) -> Option<Sole> {
    const KEY: &str = "sole_corners_m";
    let corners = section.points(KEY);
    if !section.has(KEY) || !corners.as_flattened().iter().all(|x| x.is_finite()) {
        return None;
    }
    match Sole::new(&corners) {
        Ok(sole) => Some(sole),
        Err(what) => {
            section.problem(KEY, what, Sole::ALLOWED);
            None
        }
    }
}

/// Errors that no average removes. By default those of an offset from an average of a hundred samples, as a tare
/// takes at least, and the share of [`READING_PER_CENT`].
fn lasting(section: &Section<'_, '_>, sigma: [f64; 2]) -> LastingErrors {
    let left = |key, sigma| section.number_or(key, 0.1 * sigma, Allowed::NonNegative);
    let per_cent = section.number_or(
        "reading_sigma_per_cent",
        READING_PER_CENT,
        Allowed::Within(0.0, 100.0),
    );
    LastingErrors {
        force: left("offset_sigma_N", sigma[0]),
        torque: left("offset_sigma_Nm", sigma[1]),
        share: 0.01 * per_cent,
    }
}

/// `w = sign (C raw - offset + k_T (T - T0))`, the sign multiplied out.
fn conditioning(section: &Section<'_, '_>) -> FtConditioning {
    let sign = section.sign_or("sign", 1.0);
    let identity = FtConditioning::default().calibration;
    let calibration = section.matrix_or::<6>("calibration", identity);
    let invertible = Matrix6::from_fn(|i, j| calibration[i][j]).try_inverse();
    if invertible.is_none() && calibration.as_flattened().iter().all(|x| x.is_finite()) {
        let what =
            "the matrix has no inverse, so the six components do not follow from the signals";
        section.problem("calibration", what, "a matrix with an inverse");
    }
    let six = |key| section.number_array_or::<6>(key, [0.0; 6], Allowed::Finite);
    let (offset, gain) = (six("offset"), six("temperature_gain_per_K"));
    let mut reference = 0.0;
    for key in ["temperature_gain_per_K", "reference_temperature_C"] {
        let alone = section.has(key) && !section.has("temperature");
        if alone {
            let what = "the sensor has no key temperature";
            section.problem(key, what, "the key temperature too, or neither");
        }
    }
    if section.has("temperature") {
        reference = section.number("reference_temperature_C", Allowed::Within(-273.15, 1000.0));
    }
    FtConditioning {
        calibration: calibration.map(|row| row.map(|x| sign * x)),
        offset: offset.map(|x| sign * x),
        temperature_gain: gain.map(|x| sign * x),
        reference_temperature: reference,
    }
}

/// Mean differences between two sound IMUs that neither their biases nor a mounting that is 2 degrees off
/// explain: rad/s and m/s².
const DISAGREEMENT: [f64; 2] = [0.1, 0.7];

pub(crate) fn imus(
    root: &Section<'_, '_>,
    sample_period: f64,
    wiring: &mut Wiring<'_, '_>,
) -> Vec<ImuParameters> {
    let mut sections = root.one_or_list("imu");
    let most = 1 + MAX_FURTHER_IMUS;
    if sections.len() > most {
        let what = format!("{} IMUs are not allowed", sections.len());
        root.problem("imu", what, format!("at most {most}"));
        sections.truncate(most);
    }
    let mut imus = Vec::<ImuParameters>::new();
    for (index, mut section) in sections.into_iter().enumerate() {
        if index > 0 {
            section.which = format!(" ({})", index + 1);
        }
        let imu = imu(&section, index, sample_period, wiring);
        if let Some(imu) = &imu
            && imus.iter().any(|other| other.frame == imu.frame)
        {
            section.problem(
                "frame",
                "a second IMU measures in this frame",
                "a link each",
            );
        }
        imus.extend(imu);
        section.finish();
    }
    imus
}

fn imu(
    section: &Section<'_, '_>,
    index: usize,
    sample_period: f64,
    wiring: &mut Wiring<'_, '_>,
) -> Option<ImuParameters> {
    let frame = section.text("frame", LINK);
    let sigma_gyro = section.number_or("sigma_rad_per_s", 0.005, Allowed::NonNegative);
    let sigma_accelerometer = section.number_or("sigma_m_per_s2", 0.05, Allowed::NonNegative);
    let sampling = sampling::read(section, sample_period);
    let flat_after = liveness::flat_after(section, &sampling, sample_period);
    let bus = wiring.bus(section);
    let mut disagreement = DISAGREEMENT;
    if index > 0 {
        let keys = ["disagreement_rad_per_s", "disagreement_m_per_s2"];
        for (limit, key) in disagreement.iter_mut().zip(keys) {
            *limit = section.number_or(key, *limit, Allowed::Positive);
        }
    }
    // Only noise that the file states, not a default, allows a judgement.
    let stated = |key: &'static str, sigma: f64| if section.has(key) { sigma } else { 0.0 };
    let axes = [
        (
            "gyro",
            slots::gyro(index, 0),
            Quantity::Velocity,
            stated("sigma_rad_per_s", sigma_gyro),
        ),
        (
            "accelerometer",
            slots::accelerometer(index, 0),
            Quantity::Acceleration,
            stated("sigma_m_per_s2", sigma_accelerometer),
        ),
    ];
    let mut signals = Vec::new();
    for (key, first, quantity, sigma) in axes {
        section.has(key);
        if let Some(bus) = bus {
            let reaches = wiring.connect_axes(section, key, |axis| Use {
                way: Way::Receive,
                bus,
                slot: first + axis,
                quantity,
                sign: 1.0,
                offset: 0.0,
            });
            let of_axis = |reach| liveness::signal(reach, sigma, flat_after);
            signals.extend(reaches.map(of_axis));
        }
    }
    Some(ImuParameters {
        frame: frame?.value.to_owned(),
        bus: bus?,
        sampling,
        sigma_gyro,
        sigma_accelerometer,
        signals,
        disagreement,
    })
}
