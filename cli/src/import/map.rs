//! The map: which column of a log is what.

use problem::{Allowed, Problem, line_at, listed};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use toml::Spanned;

/// A name of a column, and its place in the map.
pub(super) type ColumnName = Spanned<String>;

/// The map.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Map {
    /// Rate of the converted logs, Hz.
    #[serde(rename = "sample_rate_hz")]
    pub(super) sample_rate: f64,
    #[serde(rename = "max_gap_ms")]
    max_gap: Option<f64>,
    /// Between two fields of CSV, where the header does not show it.
    pub(super) delimiter: Option<char>,
    /// Stamps of CSV.
    pub(super) time: Option<Time>,
    /// Joints.
    #[serde(default, rename = "joint")]
    pub(super) joints: Vec<Joint>,
    #[serde(default, rename = "ft_sensor")]
    ft_sensors: Vec<FtSensor>,
    imu: Option<Imu>,
    /// The map's file, for messages.
    #[serde(skip)]
    pub(super) file: String,
    #[serde(skip)]
    text: String,
}

/// `[time]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Time {
    pub(super) column: ColumnName,
    unit: TimeUnit,
    /// Further columns that add to the stamp, such as nanoseconds beside seconds.
    #[serde(default)]
    plus: Vec<Time>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TimeUnit {
    S,
    Ms,
    Us,
    Ns,
}

impl Time {
    /// Columns whose sum is the stamp, with the seconds in one unit of each.
    pub(super) fn parts(&self) -> Vec<(&ColumnName, f64)> {
        let seconds = match self.unit {
            TimeUnit::S => 1.0,
            TimeUnit::Ms => 1e-3,
            TimeUnit::Us => 1e-6,
            TimeUnit::Ns => 1e-9,
        };
        let own = std::iter::once((&self.column, seconds));
        own.chain(self.plus.iter().flat_map(Self::parts)).collect()
    }
}

/// `[[joint]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) gear_ratio: Option<f64>,
    theta: Channel,
    q: Channel,
    i: Channel,
    tau_sensor: Option<Channel>,
    tau_feedforward: Option<Channel>,
    #[serde(default)]
    extra: BTreeMap<String, Channel>,
}

impl Joint {
    /// Channels by the names of their columns in the converted log.
    pub(super) fn channels(&self) -> impl Iterator<Item = (String, &Channel)> {
        let fixed = [("theta", &self.theta), ("q", &self.q), ("i", &self.i)];
        let sensor = self.tau_sensor.iter().map(|c| ("tau_sensor", c));
        let model = self.tau_feedforward.iter().map(|c| ("tau_feedforward", c));
        let named = fixed.into_iter().chain(sensor).chain(model);
        let named = named.map(|(name, channel)| (name.to_owned(), channel));
        named.chain(
            self.extra
                .iter()
                .map(|(name, channel)| (name.clone(), channel)),
        )
    }
}

/// One quantity of a joint.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Channel {
    pub(super) column: ColumnName,
    unit: Unit,
    #[serde(default = "one")]
    scale: f64,
    #[serde(default = "one")]
    sign: f64,
    #[serde(default)]
    pub(super) offset: f64,
    counts_per_turn: Option<f64>,
    #[serde(default)]
    pub(super) wraps: bool,
    #[serde(default)]
    side: Side,
    #[serde(default)]
    pub(super) plus: Vec<Channel>,
    /// Stamps of this column, where they are not those of `[time]`.
    pub(super) time: Option<Time>,
    /// Time by which the column is late against its stamps, ms.
    #[serde(default)]
    delay_ms: f64,
}

fn one() -> f64 {
    1.0
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Side {
    #[default]
    Own,
    Link,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
enum Unit {
    #[serde(rename = "rad")]
    Radian,
    #[serde(rename = "deg")]
    Degree,
    #[serde(rename = "turns")]
    Turn,
    #[serde(rename = "counts")]
    Count,
    #[serde(rename = "A")]
    Ampere,
    #[serde(rename = "mA")]
    Milliampere,
    #[serde(rename = "Nm")]
    NewtonMetre,
    #[serde(rename = "mNm")]
    MillinewtonMetre,
    #[serde(rename = "kNm")]
    KilonewtonMetre,
    #[serde(rename = "1")]
    AsScaled,
}

impl Unit {
    /// Units of the SI in one of it; none where `scale` or the counts of a turn say it.
    fn factor(self) -> Option<f64> {
        match self {
            Self::Radian | Self::Ampere | Self::NewtonMetre => Some(1.0),
            Self::Degree => Some(TAU / 360.0),
            Self::Turn => Some(TAU),
            Self::Milliampere | Self::MillinewtonMetre => Some(1e-3),
            Self::KilonewtonMetre => Some(1e3),
            Self::Count | Self::AsScaled => None,
        }
    }
}

const ANGLES: &[Unit] = &[
    Unit::Radian,
    Unit::Degree,
    Unit::Turn,
    Unit::Count,
    Unit::AsScaled,
];
const CURRENTS: &[Unit] = &[Unit::Ampere, Unit::Milliampere, Unit::AsScaled];
const TORQUES: &[Unit] = &[
    Unit::NewtonMetre,
    Unit::MillinewtonMetre,
    Unit::KilonewtonMetre,
    Unit::AsScaled,
];

impl Channel {
    /// SI units in one of the column's; `key` is the channel's own name.
    ///
    /// # Errors
    /// A unit that the quantity cannot have, a missing ratio, numbers that are not allowed.
    pub(super) fn factor(&self, gear_ratio: Option<f64>, key: &str) -> Result<f64, Problem> {
        let allowed = match key {
            "theta" | "q" => Some((ANGLES, "rad, deg, turns, counts or 1")),
            "i" => Some((CURRENTS, "A, mA or 1")),
            "tau_sensor" | "tau_feedforward" => Some((TORQUES, "Nm, mNm, kNm or 1")),
            _ => None,
        };
        if let Some((_, names)) = allowed.filter(|(units, _)| !units.contains(&self.unit)) {
            return Err(Problem::new(
                format!("{key}: another quantity's unit"),
                names,
            ));
        }
        let require = |name: &str, x: f64, allowed: Allowed| {
            if allowed.admits(x) {
                Ok(x)
            } else {
                Err(Problem::new(
                    format!("{key}.{name} is {x}"),
                    allowed.to_string(),
                ))
            }
        };
        require("scale", self.scale, Allowed::Finite)?;
        require("offset", self.offset, Allowed::Finite)?;
        require("delay_ms", self.delay_ms, Allowed::Finite)?;
        if self.sign.abs() != 1.0 {
            let reason = format!("{key}.sign is {}", self.sign);
            return Err(Problem::new(reason, "1 or -1; other factors are `scale`"));
        }
        let unit = match (self.unit.factor(), self.unit) {
            (Some(factor), _) => factor,
            (None, Unit::Count) => TAU / self.turn()?,
            (None, _) => 1.0,
        };
        let ratio = match (self.side, gear_ratio) {
            (Side::Own, _) => 1.0,
            (Side::Link, Some(n)) if key == "theta" => require("gear_ratio", n, Allowed::Positive)?,
            (Side::Link, _) => {
                let reason = format!("{key}: side = \"link\"");
                return Err(Problem::new(
                    reason,
                    "for theta, of a joint with `gear_ratio`",
                ));
            }
        };
        Ok(unit * self.scale * self.sign * ratio)
    }

    /// A turn in the column's unit.
    ///
    /// # Errors
    /// Counts without their number, or a quantity that does not turn.
    pub(super) fn turn(&self) -> Result<f64, Problem> {
        match (self.unit, self.counts_per_turn) {
            (Unit::Radian, _) => Ok(TAU),
            (Unit::Degree, _) => Ok(360.0),
            (Unit::Turn, _) => Ok(1.0),
            (Unit::Count, Some(counts)) if counts > 0.0 => Ok(counts),
            (Unit::Count, _) => Err(Problem::new(
                "unit = \"counts\" without `counts_per_turn`",
                "a number > 0",
            )),
            _ => Err(Problem::new("wraps = true", "for angles only")),
        }
    }

    /// Time by which the column is late against its stamps, s.
    pub(super) fn delay(&self) -> f64 {
        1e-3 * self.delay_ms
    }

    /// The map's line of its column.
    pub(super) fn line(&self, map: &Map) -> usize {
        map.line(&self.column)
    }
}

/// `[[ft_sensor]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct FtSensor {
    name: String,
    columns: [ColumnName; 6],
    #[serde(default = "ones")]
    signs: [f64; 6],
    time: Option<Time>,
}

fn ones() -> [f64; 6] {
    [1.0; 6]
}

/// `[imu]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Imu {
    gyro: [ColumnName; 3],
    accelerometer: [ColumnName; 3],
    #[serde(default)]
    gyro_unit: GyroUnit,
    #[serde(default)]
    accelerometer_unit: AccelerometerUnit,
    time: Option<Time>,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
enum GyroUnit {
    #[default]
    #[serde(rename = "rad/s")]
    Radian,
    #[serde(rename = "deg/s")]
    Degree,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
enum AccelerometerUnit {
    #[default]
    #[serde(rename = "m/s2")]
    Metre,
    #[serde(rename = "g")]
    Gravity,
}

/// Gravity in which accelerometers are scaled, m/s².
const STANDARD_GRAVITY: f64 = 9.80665;

impl Map {
    /// Reads a map; `file` is its path.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, numbers that are not allowed.
    pub(super) fn parse(text: &str, file: &str) -> Result<Self, Problem> {
        let mut map: Self = toml::from_str(text).map_err(|e| {
            let start = e.span().map_or(0, |span| span.start);
            Problem::new(e.message(), "").at(file, line_at(text, start))
        })?;
        (map.file, map.text) = (file.to_owned(), text.to_owned());
        for (key, value) in [
            ("sample_rate_hz", map.sample_rate),
            ("max_gap_ms", map.max_gap.unwrap_or(1.0)),
        ] {
            if !Allowed::Positive.admits(value) {
                let reason = format!("{key} is {value}");
                return Err(Problem::new(reason, Allowed::Positive.to_string()).at(file, 0));
            }
        }
        let names: Vec<&str> = map.joints.iter().map(|j| j.name.as_str()).collect();
        let names: Vec<&str> = names
            .into_iter()
            .chain(map.ft_sensors.iter().map(|s| s.name.as_str()))
            .collect();
        let bad = |n: &&&str| n.is_empty() || n.contains(['/', '.', ',', '\\']);
        if let Some(name) = names.iter().find(bad) {
            let reason = format!("name {name:?}");
            return Err(Problem::new(reason, "a name without / \\ . ,").at(file, 0));
        }
        if let Some(i) = (1..names.len()).find(|&i| names[..i].contains(&names[i])) {
            let reason = format!("{:?} is named twice", names[i]);
            return Err(Problem::new(reason, "each joint and sensor once").at(file, 0));
        }
        if names.is_empty() {
            let reason = "no [[joint]] and no [[ft_sensor]]";
            return Err(Problem::new(reason, "at least one").at(file, 0));
        }
        Ok(map)
    }

    /// Longest gap that is interpolated over, s.
    pub(super) fn max_gap(&self) -> f64 {
        self.max_gap.map_or(5.0 / self.sample_rate, |ms| 1e-3 * ms)
    }

    /// The line of a column's name.
    pub(super) fn line(&self, column: &ColumnName) -> usize {
        line_at(&self.text, column.span().start)
    }

    /// The refusal of a column of which the log itself gives another unit, of so many of the SI's, than the map.
    pub(super) fn contradicts(&self, name: &str, stated: f64) -> Option<Problem> {
        fn within<'a>(channel: &'a Channel, all: &mut Vec<(&'a ColumnName, [f64; 2])>) {
            if let Some(unit) = channel.unit.factor() {
                let scaled = unit * channel.scale.abs();
                all.push((&channel.column, [unit, scaled]));
            }
            of_time(channel.time.as_ref(), all);
            channel.plus.iter().for_each(|part| within(part, all));
        }
        fn of_time<'a>(time: Option<&'a Time>, all: &mut Vec<(&'a ColumnName, [f64; 2])>) {
            let parts = time.into_iter().flat_map(Time::parts);
            all.extend(parts.map(|(column, unit)| (column, [unit; 2])));
        }
        let mut all = Vec::new();
        of_time(self.time.as_ref(), &mut all);
        let channels = self.joints.iter().flat_map(Joint::channels);
        channels.for_each(|(_, channel)| within(channel, &mut all));
        let same = |unit: &f64| (unit / stated - 1.0).abs() < 1e-3;
        let (column, _) = (all.into_iter())
            .find(|(column, units)| column.get_ref() == name && !units.iter().any(same))?;
        let reason = format!("`{name}` has another unit in the log's row of units");
        let allowed = "the unit that the log states, or a log without that row";
        Some(Problem::new(reason, allowed).at(self.file.as_str(), self.line(column)))
    }

    /// Names of the columns that a log is read for, stamps among them.
    pub(super) fn names(&self) -> BTreeSet<&str> {
        fn of_channel<'a>(channel: &'a Channel, names: &mut BTreeSet<&'a str>) {
            names.insert(channel.column.get_ref());
            of_time(channel.time.as_ref(), names);
            channel.plus.iter().for_each(|c| of_channel(c, names));
        }
        fn of_time<'a>(time: Option<&'a Time>, names: &mut BTreeSet<&'a str>) {
            let parts = time.into_iter().flat_map(Time::parts);
            names.extend(parts.map(|(column, _)| column.get_ref().as_str()));
        }
        let mut names = BTreeSet::new();
        of_time(self.time.as_ref(), &mut names);
        for (_, channel) in self.joints.iter().flat_map(Joint::channels) {
            of_channel(channel, &mut names);
        }
        for sensor in &self.ft_sensors {
            names.extend(sensor.columns.iter().map(|c| c.get_ref().as_str()));
            of_time(sensor.time.as_ref(), &mut names);
        }
        if let Some(imu) = &self.imu {
            let axes = imu.gyro.iter().chain(&imu.accelerometer);
            names.extend(axes.map(|c| c.get_ref().as_str()));
            of_time(imu.time.as_ref(), &mut names);
        }
        names
    }

    /// A column that a log does not have.
    pub(super) fn missing<'a>(
        &self,
        column: &ColumnName,
        log: &str,
        names: impl IntoIterator<Item = &'a str>,
    ) -> Problem {
        let reason = format!(
            "{log} has no column `{}` among {}",
            column.get_ref(),
            listed(names)
        );
        Problem::new(reason, "a column of the log, exactly as it writes it")
            .at(self.file.as_str(), self.line(column))
    }

    /// Columns of F/T sensors and IMU.
    pub(super) fn sensor_columns(&self) -> Vec<SensorColumn<'_>> {
        const AXES: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];
        let mut all = Vec::new();
        let mut add = |name: String, column, factor, time| {
            all.push(SensorColumn {
                name,
                column,
                factor,
                time,
            });
        };
        for sensor in &self.ft_sensors {
            let time = sensor.time.as_ref();
            for ((axis, column), sign) in AXES.iter().zip(&sensor.columns).zip(sensor.signs) {
                add(format!("{}.{axis}", sensor.name), column, sign, time);
            }
        }
        if let Some(imu) = &self.imu {
            let gyro = match imu.gyro_unit {
                GyroUnit::Radian => 1.0,
                GyroUnit::Degree => TAU / 360.0,
            };
            let accelerometer = match imu.accelerometer_unit {
                AccelerometerUnit::Metre => 1.0,
                AccelerometerUnit::Gravity => STANDARD_GRAVITY,
            };
            let time = imu.time.as_ref();
            for (axis, column) in ["gx", "gy", "gz"].iter().zip(&imu.gyro) {
                add(format!("imu.{axis}"), column, gyro, time);
            }
            for (axis, column) in ["ax", "ay", "az"].iter().zip(&imu.accelerometer) {
                add(format!("imu.{axis}"), column, accelerometer, time);
            }
        }
        all
    }
}

/// One axis of a sensor.
pub(super) struct SensorColumn<'a> {
    /// Name in the converted log.
    pub(super) name: String,
    /// Name in the log.
    pub(super) column: &'a ColumnName,
    /// SI units, in the converted axis' direction, in one of the column's.
    pub(super) factor: f64,
    /// Stamps, where they are not those of `[time]`.
    pub(super) time: Option<&'a Time>,
}
