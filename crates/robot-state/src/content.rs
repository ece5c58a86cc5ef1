//! What a recording holds of every cycle.

/// Content of a recording, by which its size follows.
#[repr(u32)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Content {
    /// Everything that every cycle was given and gave.
    #[default]
    All = 0,
    /// What every cycle was given: frames, references, settings, requests. A replay computes the rest.
    Frames = 1,
    /// Angles, torques, wrenches, commands and events, floats with seven digits; no frames.
    Torques = 2,
}

impl Content {
    /// All contents, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::All, Self::Frames, Self::Torques];

    /// The number that requests carry.
    #[must_use]
    pub const fn number(self) -> u32 {
        self as u32
    }

    /// The content of that number.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|own| own.number() == number)
    }

    /// Its name on the command line and in configurations.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Frames => "frames",
            Self::Torques => "torques",
        }
    }

    /// The content of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|own| own.name() == name)
    }
}

impl core::str::FromStr for Content {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let allowed = Self::ALL.map(Self::name).join(", ");
        Self::from_name(name)
            .ok_or_else(|| format!("not the content of a recording; allowed: {allowed}"))
    }
}

impl core::fmt::Display for Content {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        out.write_str(self.name())
    }
}
