//! The parts that sources have in a joint's torque.

/// What a source's torque is from, and with that how its error goes with the errors of others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Role {
    /// The gear with slipping springs. Its sigma knows its parameters; every source from the torsion errs with them.
    Gear,
    /// A filter around that gear.
    GearFilter,
    /// The motor's current, whose error does not depend on the torsion.
    Current,
    /// A feed-forward by the rigid-body model, which knows no contacts.
    Model,
    /// Another model of the torsion, published for comparison where there is a [`Role::Gear`].
    #[default]
    Torsion,
}

impl Role {
    /// Whether the model of the gear with slipping springs is in it.
    #[must_use]
    pub fn has_gear(self) -> bool {
        matches!(self, Self::Gear | Self::GearFilter)
    }
}

/// Where the sources stand of which a set has one at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Places {
    pub(crate) gear: Option<usize>,
    pub(crate) current: Option<usize>,
    pub(crate) model: Option<usize>,
}

impl Places {
    /// Places by the sources' roles, in their order; none: a source that does not count.
    pub(crate) fn of(roles: impl Iterator<Item = Option<Role>> + Clone) -> Self {
        let place = |role: Role| roles.clone().position(|its| its == Some(role));
        Self {
            gear: place(Role::Gear),
            current: place(Role::Current),
            model: place(Role::Model),
        }
    }

    /// Whether a source's torque is not from the torsion.
    pub(crate) fn stand_apart(&self, source: usize) -> bool {
        [self.current, self.model].contains(&Some(source))
    }
}
