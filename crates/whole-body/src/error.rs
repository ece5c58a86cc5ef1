//! Refusals of sensors, contacts, links and joints.

use problem::Problem;

/// A set of sensors, contacts, links and joints from which the torques do not follow.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.problem())]
pub enum WholeBodyError {
    /// A joint was named that the model lacks.
    UnknownJoint(String),
    /// A joint of the model was not named, or was named more than once.
    JointNotNamedOnce(String),
    /// The part of the input that names a link, and the link, which the model lacks.
    UnknownLink(String, String),
    /// An F/T sensor on the root link, which cuts nothing off.
    SensorOnRoot(String),
    /// Two F/T sensors of one name.
    SensorNamedTwice(String),
    /// Two F/T sensors that cut the tree before the same link.
    SameCut(String, String, String),
    /// No set of contacts was given.
    NoHypothesis,
    /// Two sets of contacts of one name.
    HypothesisNamedTwice(String),
    /// A set of contacts from which the wrenches do not follow.
    Contacts {
        /// The set.
        hypothesis: String,
        /// The reason.
        problem: ContactProblem,
    },
    /// Weights by expected errors, where the part's expected errors have a singular covariance.
    SingularWeights(String),
    /// A number that is not finite, or a standard deviation below zero.
    BadNumber(Problem),
}

/// Why a set of contacts is refused. Parts are described by their sensors and links.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.problem())]
pub enum ContactProblem {
    /// A contact on a link that the model lacks.
    UnknownLink(String),
    /// A contact's point that is not finite, or a direction of no length.
    BadGeometry(Problem),
    /// One contact, listed twice.
    Twice(String),
    /// A part without any contact: the part.
    NoneDeclared {
        /// The part.
        part: String,
        /// A link of it, for the advice.
        link: String,
    },
    /// A part declared to be touched by nothing, and a contact on it.
    NothingAndSomething {
        /// The part.
        part: String,
        /// The contact.
        contact: String,
    },
    /// The part that a stand holds, declared to be touched by nothing.
    StandTouches(String),
    /// More than six unknowns on one part.
    TooMany {
        /// The part.
        part: String,
        /// Unknowns.
        unknowns: usize,
        /// Its contacts.
        contacts: String,
    },
    /// Contacts on one part whose wrenches cannot be distinguished.
    Dependent {
        /// The part.
        part: String,
        /// Unknowns.
        unknowns: usize,
        /// Unknowns that can be determined.
        rank: usize,
        /// Its contacts.
        contacts: String,
    },
}

impl WholeBodyError {
    /// The refusal and its remedy, without a place.
    #[must_use]
    pub fn problem(&self) -> Problem {
        match self {
            Self::UnknownJoint(joint) => Problem::new(
                format!("joint `{joint}` is not in the robot model"),
                "its moving joints",
            ),
            Self::JointNotNamedOnce(joint) => Problem::new(
                format!(
                    "joint `{joint}` must be listed exactly once: its motion enters every torque"
                ),
                "",
            ),
            Self::UnknownLink(part, link) => Problem::new(
                format!("{part}: link `{link}` is not in the robot model"),
                "its links",
            ),
            Self::SensorOnRoot(sensor) => Problem::new(
                format!("F/T sensor `{sensor}` is on the root link and separates no part"),
                "any other link",
            ),
            Self::SensorNamedTwice(sensor) => Problem::new(
                format!("F/T sensor `{sensor}` is named twice"),
                "each sensor once",
            ),
            Self::SameCut(a, b, link) => Problem::new(
                format!(
                    "F/T sensors `{a}` and `{b}` cut the tree at the same place, just before link \
                     `{link}`"
                ),
                "one sensor for each cut",
            ),
            Self::NoHypothesis => Problem::new("no contacts", "at least one set of contacts"),
            Self::HypothesisNamedTwice(name) => Problem::new(
                format!("contact set `{name}` is named twice"),
                "each name once",
            ),
            Self::Contacts {
                hypothesis,
                problem,
            } => match hypothesis.as_str() {
                "" => problem.problem(),
                name => problem.problem().of(format!("contact set `{name}`")),
            },
            Self::SingularWeights(part) => Problem::new(
                format!(
                    "weights `expected`: some equations of {part} have no expected error, so they \
                     cannot be weighted"
                ),
                "standard deviations above zero of the F/T sensors that bound it, or of the \
                 accelerometer and the angular acceleration; or weights `unit`",
            ),
            Self::BadNumber(problem) => problem.clone(),
        }
    }
}

impl ContactProblem {
    /// The refusal and its remedy, without the name of the set.
    #[must_use]
    pub fn problem(&self) -> Problem {
        match self {
            Self::UnknownLink(link) => Problem::new(
                format!("contact on link `{link}`, which is not in the robot model"),
                "its links",
            ),
            Self::BadGeometry(problem) => problem.clone(),
            Self::Twice(contact) => Problem::new(
                format!("{contact} is listed twice, and the two cannot be distinguished"),
                "each contact once",
            ),
            Self::NoneDeclared { part, link } => Problem::new(
                format!("{part} has no contact"),
                format!(
                    "a contact on one of its links, or one of type `none` (on link `{link}`, for \
                     example) if nothing touches it"
                ),
            ),
            Self::NothingAndSomething { part, contact } => Problem::new(
                format!(
                    "{part} has a contact of type `none`, which means that nothing touches it, \
                     and also {contact}"
                ),
                "one or the other",
            ),
            Self::StandTouches(part) => Problem::new(
                format!("{part} is held by a stand, so it cannot be free of contacts"),
                "a contact with unknowns, for example a full wrench on the fixed link",
            ),
            Self::TooMany {
                part,
                unknowns,
                contacts,
            } => Problem::new(
                format!(
                    "{part} has {unknowns} unknowns ({contacts}), and Newton and Euler give 6 \
                     equations for it"
                ),
                "at most 6, or another F/T sensor between the contacts",
            ),
            Self::Dependent {
                part,
                unknowns,
                rank,
                contacts,
            } => Problem::new(
                format!(
                    "{part}: {contacts} are linearly dependent: of {unknowns} unknowns only \
                     {rank} can be determined (two forces along the line through both points \
                     cancel, and so do forces of one direction at one point)"
                ),
                "fewer or other contacts, or an F/T sensor between them",
            ),
        }
    }
}
