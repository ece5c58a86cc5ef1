//! Why the torques would not follow from the sensors.

use std::fmt;

/// A set of sensors, links and joints from which the torques do not follow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WholeBodyError {
    /// A joint was named that the model lacks.
    UnknownJoint(String),
    /// A joint of the model was not named, or was named more than once.
    JointNotNamedOnce(String),
    /// What named a link, and the link that the model lacks.
    UnknownLink(String, String),
    /// An F/T sensor on the root link, which cuts nothing off.
    SensorOnRoot(String),
    /// Two F/T sensors that cut the tree at the same place.
    SameCut(String, String),
    /// An F/T sensor and its contact link, which is not beyond it.
    ContactNotBeyond(String, String),
    /// An F/T sensor, its contact link, and the other sensor that this link lies beyond.
    ContactBeyondOther(String, String, String),
    /// The unknown-wrench link, and the F/T sensor that it lies beyond.
    UnknownWrenchBeyondSensor(String, String),
    /// The unknown-wrench link of a robot with a fixed base, which moves against the root.
    UnknownWrenchWithFixedBase(String),
    /// A floating base without an IMU.
    NoImu,
    /// What has a standard deviation that is no finite number of at least zero.
    BadSigma(String),
}

impl fmt::Display for WholeBodyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownJoint(joint) => {
                write!(
                    f,
                    "joint `{joint}` is not in the robot model; allowed: its moving joints"
                )
            }
            Self::JointNotNamedOnce(joint) => write!(
                f,
                "joint `{joint}` must be listed exactly once: its motion enters every torque"
            ),
            Self::UnknownLink(what, link) => {
                write!(
                    f,
                    "{what}: link `{link}` is not in the robot model; allowed: its links"
                )
            }
            Self::SensorOnRoot(sensor) => write!(
                f,
                "F/T sensor `{sensor}` is on the root link and cuts nothing off; allowed: any \
                 other link"
            ),
            Self::SameCut(a, b) => write!(
                f,
                "F/T sensors `{a}` and `{b}` cut the tree at the same place; allowed: one each"
            ),
            Self::ContactNotBeyond(sensor, link) => write!(
                f,
                "F/T sensor `{sensor}`: contact link `{link}` is not beyond the sensor; allowed: \
                 its own link and those it carries"
            ),
            Self::ContactBeyondOther(sensor, link, other) => write!(
                f,
                "F/T sensor `{sensor}`: contact link `{link}` lies beyond F/T sensor `{other}`, \
                 which has a contact of its own; allowed: links between the two"
            ),
            Self::UnknownWrenchBeyondSensor(link, sensor) => write!(
                f,
                "unknown-wrench link `{link}` lies beyond F/T sensor `{sensor}`, whose contact \
                 wrench is unknown too: the two cannot be told apart; allowed: links before every \
                 F/T sensor"
            ),
            Self::UnknownWrenchWithFixedBase(link) => write!(
                f,
                "unknown-wrench link `{link}`: the base is fixed, and the wrench of its mounting \
                 is unknown already; allowed: links that do not move, or none"
            ),
            Self::NoImu => write!(
                f,
                "a floating base needs an IMU: without it acceleration and weight are unknown"
            ),
            Self::BadSigma(what) => {
                write!(
                    f,
                    "standard deviation of {what}; allowed: a finite number >= 0"
                )
            }
        }
    }
}

impl std::error::Error for WholeBodyError {}
