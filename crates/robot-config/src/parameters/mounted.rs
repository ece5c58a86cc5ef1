//! Drives that are nodes of their buses, as bought and mounted: what a simulated one is made of.

/// A drive that is a node of its bus.
#[derive(Debug, Clone, PartialEq)]
pub struct MountedDrive {
    /// Index of its joint.
    pub joint: usize,
    /// Index of its bus.
    pub bus: u8,
    /// Its node id.
    pub node: u8,
    /// What it is.
    pub sheet: NodeSheet,
    /// How its motor's angle counts.
    pub motor: Mount,
    /// How its link encoder's angle counts.
    pub link: Mount,
    /// How its current counts.
    pub current: Mount,
}

/// `quantity = direction * what the drive counts + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// 1 or -1.
    pub direction: f64,
    /// In the quantity's unit.
    pub offset: f64,
}

impl Default for Mount {
    fn default() -> Self {
        Self {
            direction: 1.0,
            offset: 0.0,
        }
    }
}

impl Mount {
    /// What the drive counts for a quantity.
    #[must_use]
    pub fn counted(self, quantity: f64) -> f64 {
        self.direction * (quantity - self.offset)
    }

    /// The quantity of what the drive counts.
    #[must_use]
    pub fn quantity(self, counted: f64) -> f64 {
        self.direction * counted + self.offset
    }
}

/// What a drive is, by its data sheet.
#[derive(Debug, Clone, PartialEq)]
pub enum NodeSheet {
    /// A CANopen drive of CiA 402.
    Canopen(CanopenSheet),
    /// An actuator with frames of its maker's own.
    Actuator(ActuatorSheet),
}

/// A CANopen drive.
#[derive(Debug, Clone, PartialEq)]
pub struct CanopenSheet {
    /// 6064 and 607A count at the link, not at the motor.
    pub position_at_link: bool,
    /// Index and sub-index of the other side's angle.
    pub other_angle: Option<(u16, u8)>,
    /// Unit of 606C, rpm of the motor; none: rpm.
    pub velocity_rpm_per_count: Option<f64>,
    /// Rated current (6075), A.
    pub rated_current: f64,
    /// Current that makes the rated torque (6076), A.
    pub current_per_torque: f64,
    /// Rated torque at the joint, N·m.
    pub rated_torque: f64,
    /// Index and sub-index of a temperature, its length in bits, and one count of it, °C.
    pub temperature: Option<((u16, u8), u8, f64)>,
    /// Number of the maker (1018:01).
    pub vendor: Option<u32>,
    /// Number of the product (1018:02).
    pub product: Option<u32>,
    /// Further objects that it has, and their lengths in bytes.
    pub objects: Vec<((u16, u8), usize)>,
}

/// An actuator.
#[derive(Debug, Clone, PartialEq)]
pub struct ActuatorSheet {
    /// Its family.
    pub family: &'static str,
    /// The identifier to which it answers, where its family has one.
    pub reply: u16,
    /// Position, rad, velocity, rad/s, and torque, N·m, at the ends of its frames' ranges.
    pub ranges: [f64; 3],
    /// Gains that it has where its frames have none, N·m/rad and N·m·s/rad.
    pub gains: [f64; 2],
    /// Time between two samples that it sends by itself, s.
    pub period: f64,
}
