//! A calibration on the disk: a folder of joint files with what they were made from.

use problem::Problem;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use torqued_client::robot_state::JointKind;

/// The file that says what a folder holds.
pub(crate) const MANIFEST: &str = "calibration.toml";

/// Robot and recordings that a calibration is of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    /// The robot's name.
    pub(crate) robot: String,
    /// When it was made, UTC.
    pub(crate) made: String,
    /// Version of torquectl.
    pub(crate) version: String,
    /// The recordings.
    #[serde(rename = "run")]
    pub(crate) runs: Vec<RunEntry>,
    /// Every joint of the robot.
    #[serde(default, rename = "joint")]
    pub(crate) joints: Vec<JointEntry>,
    /// Every F/T sensor.
    #[serde(default, rename = "ft_sensor", skip_serializing_if = "Vec::is_empty")]
    pub(crate) sensors: Vec<SensorEntry>,
    /// Every kind of drive.
    #[serde(default, rename = "drive", skip_serializing_if = "Vec::is_empty")]
    pub(crate) drives: Vec<DriveEntry>,
    /// Keys of robot.toml that a commit sets beside `calibration`, by their address.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) settings: BTreeMap<String, toml::Value>,
    /// The URDF with other inertias, where there are some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) urdf: Option<UrdfEntry>,
}

/// A URDF whose inertias are corrected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct UrdfEntry {
    pub(crate) file: String,
    /// SHA-256 of the URDF that it corrects.
    pub(crate) of_sha256: String,
}

/// A number and half the width of its 95 % interval.
pub(crate) type Interval = [f64; 2];

/// An F/T sensor.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SensorEntry {
    pub(crate) name: String,
    pub(crate) identity: String,
    /// Why it could not be calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) why: Option<String>,
    /// The link that holds the mass beyond the sensor.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) link: String,
    /// Reading without load, before the sign: fx to tz, N and N·m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) offset: Vec<Interval>,
    #[serde(rename = "mass_kg", default, skip_serializing_if = "Option::is_none")]
    pub(crate) mass: Option<Interval>,
    #[serde(rename = "centre_m", default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) centre: Vec<Interval>,
    /// Angles about x, y, z by which the sensor's axes are turned against its frame.
    #[serde(
        rename = "misalignment_deg",
        default,
        skip_serializing_if = "Vec::is_empty"
    )]
    pub(crate) misalignment: Vec<Interval>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) undetermined: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) condition: Option<f64>,
    /// Largest angle between two directions of gravity in the link's axes.
    #[serde(
        rename = "gravity_turned_deg",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub(crate) turned: Option<f64>,
    /// RMS as it was configured, and held out: with the offset found alone, and with everything found.
    #[serde(rename = "rms_N", default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) rms_force: Vec<f64>,
    #[serde(rename = "rms_Nm", default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) rms_torque: Vec<f64>,
    /// Whether mass and centre predict what was held out better than the URDF's: only then they are adopted.
    #[serde(default)]
    pub(crate) better: bool,
}

/// A kind of drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DriveEntry {
    pub(crate) name: String,
    pub(crate) identity: String,
    /// Joints whose motion shows it.
    pub(crate) joints: Vec<String>,
    /// Why some joints show nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) why: Vec<String>,
    #[serde(default, rename = "key", skip_serializing_if = "Vec::is_empty")]
    pub(crate) keys: Vec<KeyEntry>,
}

/// A key of a kind of drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KeyEntry {
    pub(crate) address: String,
    pub(crate) value: Interval,
    pub(crate) configured: f64,
    /// agrees, differs, or how joints contradict one another.
    pub(crate) state: String,
}

/// A recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RunEntry {
    pub(crate) file: String,
    pub(crate) sha256: String,
    /// When it began, UTC.
    pub(crate) date: String,
    /// Duration of what was used, s.
    pub(crate) seconds: f64,
}

/// A joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct JointEntry {
    pub(crate) name: String,
    /// Hash of the keys that the calibration depends on.
    pub(crate) identity: String,
    /// Its joint file; none if it could not be calibrated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) file: Option<String>,
    /// Why it could not be calibrated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) why: Option<String>,
    /// It slides: its torques are forces, in N.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) prismatic: bool,
    /// RMS of fused torque less reference on a quarter of each run that was held out, N·m.
    #[serde(rename = "held_out_rms_Nm", skip_serializing_if = "Option::is_none")]
    pub(crate) held_out_rms: Option<f64>,
    /// The same over the published sigma.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) held_out_rms_of_sigma: Option<f64>,
    /// Largest reference torque, N·m.
    #[serde(rename = "largest_Nm", skip_serializing_if = "Option::is_none")]
    pub(crate) largest: Option<f64>,
    /// Constants that stay at their priors.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) undetermined: Vec<String>,
}

impl JointEntry {
    /// Sources of its torques.
    pub(crate) fn kind(&self) -> JointKind {
        if self.prismatic {
            JointKind::Prismatic
        } else {
            JointKind::Revolute
        }
    }
}

/// A calibration as its folder holds it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Calibration {
    pub(crate) manifest: Manifest,
    /// Texts by file name.
    pub(crate) files: BTreeMap<String, String>,
}

impl Calibration {
    /// Reads a folder; every file that it names must be there.
    ///
    /// # Errors
    /// A folder that holds no calibration.
    pub(crate) fn read(folder: &Path) -> Result<Self, Problem> {
        let text = |name: &str| {
            let path = folder.join(name);
            let shown = path.display().to_string();
            let bytes = fs::read(&path).map_err(|e| {
                let allowed = "a folder that `torquectl calibrate` wrote";
                Problem::new(format!("cannot be read: {e}"), allowed).at(&shown, 0)
            })?;
            problem::text(bytes, &shown)
        };
        let manifest: Manifest = toml::from_str(&text(MANIFEST)?).map_err(|e| {
            let shown = folder.join(MANIFEST).display().to_string();
            Problem::new(e.message(), "").at(shown, 0)
        })?;
        let named = manifest.joints.iter();
        let named = named.filter_map(|joint| joint.file.clone());
        let named = named.chain(manifest.urdf.iter().map(|urdf| urdf.file.clone()));
        let files = named.map(|name| Ok::<_, Problem>((name.clone(), text(&name)?)));
        let files = files.collect::<Result<_, _>>()?;
        Ok(Self { manifest, files })
    }

    /// Writes it as a new folder, all of it or nothing.
    ///
    /// # Errors
    /// A folder that is there already, or a file that cannot be written: nothing is left of it.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), Problem> {
        if folder.exists() {
            let shown = folder.display().to_string();
            return Err(
                Problem::new("is there already", "a folder that is not there").at(shown, 0),
            );
        }
        let manifest = toml::to_string(&self.manifest)
            .map_err(|e| Problem::new(format!("{MANIFEST}: {e}"), ""))?;
        let partial = partial(folder);
        let unwritable = |e: &io::Error| Problem::unwritable(folder.display(), e);
        let written = self.write_into(&partial, &manifest).and_then(|()| {
            fs::rename(&partial, folder)?;
            terminal::sync_folder(folder.parent())
        });
        written.map_err(|e| {
            let _ = fs::remove_dir_all(&partial);
            unwritable(&e)
        })
    }

    fn write_into(&self, folder: &Path, manifest: &str) -> io::Result<()> {
        if let Some(parent) = folder.parent().filter(|p| !p.as_os_str().is_empty()) {
            fs::create_dir_all(parent)?;
        }
        fs::create_dir(folder)?;
        for (name, text) in &self.files {
            write_whole(&folder.join(name), text)?;
        }
        write_whole(&folder.join(MANIFEST), manifest)?;
        terminal::sync_folder(Some(folder))
    }
}

/// A name beside `path` for what is not whole yet.
fn partial(path: &Path) -> PathBuf {
    let name = path
        .file_name()
        .map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    path.with_file_name(format!(".{name}.partial-{}", std::process::id()))
}

fn write_whole(path: &Path, text: &str) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
}
