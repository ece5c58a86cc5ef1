//! Why the torques would not follow from the sensors.

use std::fmt;

/// A set of sensors, contacts, links and joints from which the torques do not follow.
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
        /// What is wrong with it.
        problem: ContactProblem,
    },
    /// What should be a finite number of at least zero, or a direction, and is not.
    BadNumber(String),
}

/// What is wrong with a set of contacts. Parts are described by their sensors and links.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ContactProblem {
    /// A contact on a link that the model lacks.
    UnknownLink(String),
    /// A contact's direction or point that is none.
    BadGeometry(String),
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
    /// Contacts on one part whose wrenches can not be told apart.
    Dependent {
        /// The part.
        part: String,
        /// Unknowns.
        unknowns: usize,
        /// Unknowns that can be found.
        rank: usize,
        /// Its contacts.
        contacts: String,
    },
}

impl fmt::Display for WholeBodyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownJoint(joint) => write!(
                f,
                "joint `{joint}` is not in the robot model; allowed: its moving joints"
            ),
            Self::JointNotNamedOnce(joint) => write!(
                f,
                "joint `{joint}` must be listed exactly once: its motion enters every torque"
            ),
            Self::UnknownLink(what, link) => write!(
                f,
                "{what}: link `{link}` is not in the robot model; allowed: its links"
            ),
            Self::SensorOnRoot(sensor) => write!(
                f,
                "F/T sensor `{sensor}` is on the root link and cuts nothing off; allowed: any \
                 other link"
            ),
            Self::SensorNamedTwice(sensor) => write!(
                f,
                "F/T sensor `{sensor}` is named twice; allowed: each sensor once"
            ),
            Self::SameCut(a, b, link) => write!(
                f,
                "F/T sensors `{a}` and `{b}` cut the tree at the same place, just before link \
                 `{link}`; allowed: one each"
            ),
            Self::NoHypothesis => write!(f, "no contacts; allowed: at least one set of contacts"),
            Self::HypothesisNamedTwice(name) => write!(
                f,
                "contact hypothesis `{name}` is named twice; allowed: each name once"
            ),
            Self::Contacts {
                hypothesis,
                problem,
            } if hypothesis.is_empty() => write!(f, "{problem}"),
            Self::Contacts {
                hypothesis,
                problem,
            } => write!(f, "contact hypothesis `{hypothesis}`: {problem}"),
            Self::BadNumber(what) => write!(f, "{what}"),
        }
    }
}

impl fmt::Display for ContactProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownLink(link) => write!(
                f,
                "contact on link `{link}`, which is not in the robot model; allowed: its links"
            ),
            Self::BadGeometry(what) => write!(f, "{what}"),
            Self::Twice(contact) => write!(
                f,
                "{contact} is listed twice: the two cannot be told apart; allowed: once"
            ),
            Self::NoneDeclared { part, link } => write!(
                f,
                "{part} has no contact, and what touches it must be known or unknown; allowed: a \
                 contact on one of its links, or one of type `none` (on link `{link}`, say) if \
                 nothing touches it"
            ),
            Self::NothingAndSomething { part, contact } => write!(
                f,
                "{part}: a contact of type `none` says that nothing touches it, and {contact} \
                 says otherwise; allowed: one or the other"
            ),
            Self::StandTouches(part) => write!(
                f,
                "{part} is held by a stand, so something touches it; allowed: a contact with \
                 unknowns, a full wrench on the fixed link say"
            ),
            Self::TooMany {
                part,
                unknowns,
                contacts,
            } => write!(
                f,
                "{part} has {unknowns} unknowns ({contacts}), and Newton and Euler give 6 \
                 equations for it; allowed: at most 6, or another F/T sensor between the contacts"
            ),
            Self::Dependent {
                part,
                unknowns,
                rank,
                contacts,
            } => write!(
                f,
                "{part}: {contacts} depend on one another: of {unknowns} unknowns only {rank} can \
                 be told apart (two forces along the line through both points cancel, and so do \
                 forces of one direction at one point); allowed: fewer or other contacts, or an \
                 F/T sensor between them"
            ),
        }
    }
}

impl std::error::Error for WholeBodyError {}
impl std::error::Error for ContactProblem {}
