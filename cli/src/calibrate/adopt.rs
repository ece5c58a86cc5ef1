//! A calibration becomes a robot's own: its files beside the configuration, the keys `calibration` of
//! the configuration, and the way back.

use super::identity::Identity;
use super::store::{Calibration, replace};
use jiff::Timestamp;
use problem::{Problem, Problems};
use robot_config::Robot;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Folder of calibrations beside a configuration.
const FOLDER: &str = "calibrations";
/// The file in an adopted folder that says what the keys were before.
const BEFORE: &str = "before.toml";

/// A robot's configuration as a text that is changed.
pub(crate) struct Configuration {
    pub(crate) path: PathBuf,
    text: String,
    pub(crate) robot: Robot,
    pub(crate) identity: Identity,
}

#[derive(Deserialize)]
struct Keys {
    joint: Vec<JointKeys>,
}

#[derive(Deserialize)]
struct JointKeys {
    name: Spanned<String>,
    calibration: Option<Spanned<String>>,
}

/// Values of `calibration` by joint.
pub(crate) type Adopted = BTreeMap<String, String>;

impl Configuration {
    /// Reads a configuration.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub(crate) fn read(path: &Path) -> Result<Self, Problems> {
        let shown = path.to_string_lossy();
        let robot = robot_config::load(&shown, &|path| std::fs::read_to_string(path))?;
        let text = std::fs::read_to_string(path).map_err(|e| Problem::unreadable(&shown, &e))?;
        Ok(Self {
            identity: Identity::new(&text, &shown)?,
            path: path.to_path_buf(),
            text,
            robot,
        })
    }

    /// The keys `calibration`, by joint.
    pub(crate) fn adopted(&self) -> Result<Adopted, Problem> {
        let joints = self.keys()?.joint.into_iter();
        let named = joints.filter_map(|joint| {
            let file = joint.calibration?.into_inner();
            Some((joint.name.into_inner(), file))
        });
        Ok(named.collect())
    }

    /// A path that a key names.
    pub(crate) fn resolved(&self, file: &str) -> PathBuf {
        self.folder().join(file)
    }

    fn folder(&self) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).to_path_buf()
    }

    fn keys(&self) -> Result<Keys, Problem> {
        let shown = self.path.display().to_string();
        toml::from_str(&self.text).map_err(|e| Problem::new(e.message(), "").at(shown, 0))
    }

    /// The text with other keys; joints that are not in `adopted` have none.
    fn with(&self, adopted: &Adopted) -> Result<String, Problem> {
        let mut text = self.text.clone();
        // From the end, so that places before stay.
        for joint in self.keys()?.joint.iter().rev() {
            let wanted = adopted.get(joint.name.get_ref());
            let quoted = |file: &str| toml::Value::from(file).to_string();
            match (&joint.calibration, wanted) {
                (Some(old), Some(file)) => text.replace_range(old.span(), &quoted(file)),
                (Some(old), None) => {
                    let begin = text[..old.span().start].rfind('\n').map_or(0, |at| at + 1);
                    let end = text[old.span().end..].find('\n');
                    let end = end.map_or(text.len(), |at| old.span().end + at + 1);
                    text.replace_range(begin..end, "");
                }
                (None, Some(file)) => {
                    let end = joint.name.span().end;
                    let line = text[end..].find('\n').map_or(text.len(), |at| end + at);
                    text.insert_str(line, &format!("\ncalibration = {}", quoted(file)));
                }
                (None, None) => {}
            }
        }
        Ok(text)
    }

    /// Writes the configuration with other keys, at once, if it is sound with them.
    fn adopt(&self, adopted: &Adopted) -> Result<(), Problems> {
        let text = self.with(adopted)?;
        let own = self.path.to_string_lossy();
        robot_config::load(&own, &|path| match path == own {
            true => Ok(text.clone()),
            false => std::fs::read_to_string(path),
        })?;
        Ok(replace(&self.path, &text)?)
    }
}

/// Adopts a calibration: its files go into a dated folder beside the configuration, whose keys then name
/// them. Gives the folder.
///
/// # Errors
/// A calibration of another robot, or one without any joint; files that cannot be written. The old
/// calibration stays then.
pub(crate) fn commit(config: &Path, folder: &Path) -> Result<PathBuf, Problems> {
    let configuration = Configuration::read(config)?;
    let mut calibration = Calibration::read(folder)?;
    check(&configuration.identity, &calibration)
        .map_err(|p| p.or_at(&folder.display().to_string(), 0))?;
    let before = configuration.adopted()?;
    let text = toml::to_string(&before).map_err(|e| Problem::new(e.to_string(), ""))?;
    calibration.files.insert(BEFORE.to_owned(), text);
    // Named by the commit: the newest is the last one.
    let date = format!("{:.0}", Timestamp::now()).replace(':', "-");
    let numbers = std::iter::once(String::new()).chain((2..).map(|n| format!("-{n}")));
    let mut folders = numbers.map(|number| Path::new(FOLDER).join(format!("{date}{number}")));
    let free = |kept: &PathBuf| !configuration.folder().join(kept).exists();
    let kept = folders.find(free).unwrap_or_default();
    let place = configuration.folder().join(&kept);
    calibration.write(&place)?;
    // Joints that this calibration lacks keep theirs.
    let mut adopted = before;
    for joint in &calibration.manifest.joints {
        if let Some(file) = &joint.file {
            let path = kept.join(file).to_string_lossy().into_owned();
            adopted.insert(joint.name.clone(), path);
        }
    }
    if let Err(problems) = configuration.adopt(&adopted) {
        let _ = std::fs::remove_dir_all(&place);
        return Err(problems);
    }
    Ok(place)
}

/// Goes back to the keys before the last commit. Gives the folder that is in use no longer.
///
/// # Errors
/// A configuration that was never committed to; files that cannot be written.
pub(crate) fn rollback(config: &Path) -> Result<PathBuf, Problems> {
    let configuration = Configuration::read(config)?;
    let last = configuration.adopted()?.into_values();
    let folders = last.filter_map(|file| {
        let path = configuration.resolved(&file);
        let folder = path.parent()?.to_path_buf();
        folder.join(BEFORE).is_file().then_some(folder)
    });
    // Names are dates: the newest is the last one.
    let Some(folder) = folders.max() else {
        let reason = "no calibration was committed to this configuration";
        let allowed = "a configuration after `torquectl calibrate commit`";
        return Err(Problem::new(reason, allowed)
            .at(config.display().to_string(), 0)
            .into());
    };
    let path = folder.join(BEFORE);
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(&path).map_err(|e| Problem::unreadable(&shown, &e))?;
    let before: Adopted =
        toml::from_str(&text).map_err(|e| Problem::new(e.message(), "").at(shown, 0))?;
    configuration.adopt(&before)?;
    Ok(folder)
}

/// A calibration must be of this robot.
fn check(identity: &Identity, calibration: &Calibration) -> Result<(), Problem> {
    let manifest = &calibration.manifest;
    let refuse = |reason: String| Err(Problem::new(reason, "a calibration of this robot"));
    if manifest.robot != identity.robot {
        let (theirs, ours) = (&manifest.robot, &identity.robot);
        return refuse(format!(
            "is a calibration of robot {theirs:?}, not of {ours:?}"
        ));
    }
    for joint in &manifest.joints {
        if identity.hash(&joint.name).as_ref() != Some(&joint.identity) {
            let name = &joint.name;
            return refuse(format!(
                "joint {name}: drive, encoders, their directions and zeros, or the rate are others now than in its \
                 recordings"
            ));
        }
    }
    if calibration.files.is_empty() {
        return refuse("no joint of it could be calibrated".to_owned());
    }
    Ok(())
}
