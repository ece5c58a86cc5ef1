//! The effective configuration: every key that is asked for, with its value and where that comes from.

/// A key of the configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting {
    /// Its path, with the name of the joint, drive or sensor that it belongs to: `joint.gains.K_p (knee)`.
    pub key: String,
    /// Its value, as TOML has it.
    pub value: String,
    /// Where it comes from.
    pub source: Source,
}

/// Where a value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A line of the file.
    Line(usize),
    /// The file lacks the key.
    Default,
}
