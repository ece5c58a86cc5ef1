//! From two wrapping encoder readings to unwrapped angles and their torsion at one instant.

use robot_state::measured_flags;

/// A joint's two encoders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncoderParameters {
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Largest |dq| of the joint, rad/s, link side, from which on a change of a reading is a jump unless
    /// the joint has come to it sample by sample.
    pub max_velocity: f64,
    /// Largest change of dq within a period by the greatest torques at rotor and gear, rad/s, link side;
    /// 0 where it is not known: then `max_velocity` is never exceeded.
    pub max_velocity_change: f64,
    /// Range after which the motor-side reading wraps, rad, motor side; infinite if never.
    pub motor_wrap: f64,
    /// Range after which the link-side reading wraps, rad, link side; infinite if never.
    pub link_wrap: f64,
    /// Skew: delay of the motor-side encoder's sample after the link-side one's, s; may be
    /// negative, at most 16 periods.
    pub skew: f64,
}

/// A joint's angles, unwrapped.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointAngles {
    /// theta: motor-side angle, rad, unwrapped; the newest that could be used.
    pub theta: f64,
    /// q: link-side angle, rad, unwrapped; the newest that could be used.
    pub q: f64,
    /// theta at the instant of the earlier of both samples, rad.
    pub aligned_theta: f64,
    /// q at the same instant: delayed by the skew if the link-side encoder is sampled later, rad.
    pub aligned_q: f64,
    /// theta/N - q with the skew removed, rad.
    pub torsion: f64,
    /// Bits of `measured_flags`: `MISSED`, `JUMP`, `NEVER`.
    pub flags: u32,
}

/// One encoder's readings made continuous.
#[derive(Debug, Clone, Copy)]
struct Unwrapped {
    /// Range after which the reading wraps, rad.
    wrap: f64,
    /// Largest change in one period, rad.
    max_step: f64,
    /// Largest change of that change from one period to the next, rad; 0 where it is not known.
    max_bend: f64,
    /// The last reading that was used, rad; none before the first.
    angle: Option<f64>,
    /// Periods since then.
    periods: u32,
    /// Change per period up to the last reading, rad; none where a reading before it was none of the joint's.
    rate: Option<f64>,
    /// A reading since the last one that was used has jumped.
    jumped: bool,
    /// The last reading, rad, if it has jumped.
    elsewhere: Option<f64>,
    /// It has jumped to where the one before had.
    stays: bool,
}

/// Share of a way by which instants of sampling may make the next one differ.
const JITTER: f64 = 0.25;

/// Outcome of a reading.
enum Taken {
    Used,
    Missed,
    Jumped,
}

impl Unwrapped {
    fn new(wrap: f64, max_step: f64, max_bend: f64) -> Self {
        Self {
            wrap,
            max_step,
            max_bend,
            angle: None,
            periods: 0,
            rate: None,
            jumped: false,
            elsewhere: None,
            stays: false,
        }
    }

    /// The turn of `reading` that is nearest to `near`.
    fn nearest_turn(&self, reading: f64, near: f64) -> f64 {
        if self.wrap.is_finite() && self.wrap > 0.0 {
            reading + self.wrap * ((near - reading) / self.wrap).round()
        } else {
            reading
        }
    }

    /// Takes a reading, not finite if there is none, which is expected near `near`.
    fn take(&mut self, reading: f64, near: f64) -> Taken {
        self.periods = self.periods.saturating_add(1);
        let elsewhere = self.elsewhere.take();
        self.stays = false;
        if !reading.is_finite() {
            return Taken::Missed;
        }
        let angle = self.nearest_turn(reading, near);
        // The change that the joint may have made grows with the length of a gap, so a reading that
        // stays at another angle is accepted after the time that the joint would need to get there.
        let periods = f64::from(self.periods);
        let reach = self.max_step * periods;
        if let Some(last) = self.angle {
            if (angle - near).abs() > reach && !self.goes_on(angle - last, periods) {
                self.stays =
                    elsewhere.is_some_and(|before| (angle - before).abs() <= self.max_step);
                (self.jumped, self.elsewhere) = (true, Some(angle));
                return Taken::Jumped;
            }
            self.rate = (!self.jumped).then_some((angle - last) / periods);
        }
        self.angle = Some(angle);
        (self.periods, self.jumped) = (0, false);
        Taken::Used
    }

    /// Whether a way in so many periods goes on from the last ones. What turns a joint faster than its drive
    /// can (a foot put down hard) does so sample by sample, as torques and inertias have it; an encoder that
    /// slips has no velocity before and after, and one that has jumped none that is known.
    fn goes_on(&self, way: f64, periods: f64) -> bool {
        let Some(rate) = self.rate.filter(|_| !self.jumped && self.max_bend > 0.0) else {
            return false;
        };
        let bend = (0.5 * self.max_bend * periods * (periods + 1.0)).min(self.max_step * periods);
        (way - rate * periods).abs() <= bend + JITTER * rate.abs()
    }
}

/// Samples kept, to read an angle as long ago as the skew.
const HISTORY: usize = 18;
/// Largest skew, samples.
const LONGEST_SKEW: f64 = (HISTORY - 2) as f64;

/// The last samples of one angle, for reading it at an earlier instant.
#[derive(Debug, Clone, Copy)]
struct History {
    angles: [f64; HISTORY],
    newest: usize,
}

impl History {
    fn filled(angle: f64) -> Self {
        Self {
            angles: [angle; HISTORY],
            newest: 0,
        }
    }

    fn push(&mut self, angle: f64) {
        self.newest = (self.newest + 1) % HISTORY;
        self.angles[self.newest] = angle;
    }

    /// The angle `samples` ago, linearly interpolated.
    fn ago(&self, samples: f64) -> f64 {
        let whole = samples.floor();
        let at = |back: usize| self.angles[(self.newest + HISTORY - back) % HISTORY];
        let back = (whole as usize).min(HISTORY - 2);
        at(back) + (samples - whole) * (at(back + 1) - at(back))
    }
}

/// Both encoders of a joint, or its motor's alone, followed over many turns.
#[derive(Debug, Clone)]
pub struct JointEncoders {
    parameters: EncoderParameters,
    /// There is a link-side encoder.
    has_link: bool,
    motor: Unwrapped,
    link: Unwrapped,
    /// theta - N q when both readings were last used, rad: the torsion, motor side.
    offset: f64,
    /// theta and q over the last samples; none before both encoders have answered.
    history: Option<(History, History)>,
    last: JointAngles,
}

impl JointEncoders {
    /// Encoders that have not been read yet.
    #[must_use]
    pub fn new(parameters: EncoderParameters) -> Self {
        let EncoderParameters {
            gear_ratio,
            sample_period,
            max_velocity,
            max_velocity_change,
            ..
        } = parameters;
        let max_step = max_velocity * sample_period;
        let max_bend = max_velocity_change * sample_period;
        let longest = LONGEST_SKEW * sample_period;
        debug_assert!(
            parameters.skew.abs() <= longest,
            "skew {} s",
            parameters.skew
        );
        let skew = parameters.skew.clamp(-longest, longest);
        Self {
            parameters: EncoderParameters { skew, ..parameters },
            has_link: true,
            motor: Unwrapped::new(
                parameters.motor_wrap,
                max_step * gear_ratio,
                max_bend * gear_ratio,
            ),
            link: Unwrapped::new(parameters.link_wrap, max_step, max_bend),
            offset: 0.0,
            history: None,
            last: JointAngles {
                flags: measured_flags::NEVER,
                ..JointAngles::default()
            },
        }
    }

    /// The motor-side encoder of a joint that has no other. Its first reading is taken as the turn
    /// nearest to zero, and `q` is `theta/N`: the torsion is not known here and counts as zero.
    #[must_use]
    pub fn of_motor(parameters: EncoderParameters) -> Self {
        Self {
            has_link: false,
            ..Self::new(parameters)
        }
    }

    /// Forgets everything, also which turn the motor is on.
    pub fn reset(&mut self) {
        *self = Self {
            has_link: self.has_link,
            ..Self::new(self.parameters)
        };
    }

    /// The angles after the last readings.
    #[must_use]
    pub fn angles(&self) -> &JointAngles {
        &self.last
    }

    /// theta and q, rad, as they were read last, also where they jumped.
    #[must_use]
    pub fn read(&self) -> [f64; 2] {
        let of = |encoder: &Unwrapped| encoder.elsewhere.or(encoder.angle);
        let q = of(&self.link).unwrap_or(self.last.q);
        [of(&self.motor).unwrap_or(self.last.theta), q]
    }

    /// The last reading of one encoder jumped to where the one before had: no corrupt reading does.
    #[must_use]
    pub fn stays_elsewhere(&self) -> bool {
        self.motor.stays || self.link.stays
    }

    /// Takes one reading of each encoder; NaN where there is none.
    pub fn update(&mut self, motor_reading: f64, link_reading: f64) -> JointAngles {
        let n = self.parameters.gear_ratio;
        if !self.has_link {
            return self.update_motor(motor_reading);
        }
        // The link-side encoder first: it determines the motor's turn. Its own first
        // reading is taken as the turn nearest to zero.
        let link = self.link.take(link_reading, self.link.angle.unwrap_or(0.0));
        let motor = match (self.link.angle, self.motor.angle) {
            // The turn is not known yet.
            (None, _) => Taken::Missed,
            // At first the turn with |theta/N - q| smallest.
            (Some(q), None) => {
                let taken = self.motor.take(motor_reading, n * q);
                self.offset = self.motor.angle.map_or(0.0, |theta| theta - n * q);
                taken
            }
            // Afterwards the turn nearest to the link's motion, so that the motor may run through
            // several turns between two readings; unless the link's last reading is the older.
            (Some(q), Some(theta)) => {
                let link_leads = self.link.periods <= self.motor.periods;
                let near = if link_leads {
                    n * q + self.offset
                } else {
                    theta
                };
                self.motor.take(motor_reading, near)
            }
        };
        let (Some(theta), Some(q)) = (self.motor.angle, self.link.angle) else {
            self.last.flags = measured_flags::NEVER | measured_flags::MISSED;
            return self.last;
        };
        let flags = match (link, motor) {
            (Taken::Used, Taken::Used) => {
                self.offset = theta - n * q;
                0
            }
            (Taken::Jumped, Taken::Missed) | (Taken::Missed, Taken::Jumped) => {
                measured_flags::JUMP | measured_flags::MISSED
            }
            (Taken::Jumped, _) | (_, Taken::Jumped) => measured_flags::JUMP,
            _ => measured_flags::MISSED,
        };
        self.last = self.align(theta, q, flags);
        self.last
    }

    /// Takes the reading of the only encoder.
    fn update_motor(&mut self, reading: f64) -> JointAngles {
        let taken = (self.motor).take(reading, self.motor.angle.unwrap_or(0.0));
        let Some(theta) = self.motor.angle else {
            self.last.flags = measured_flags::NEVER | measured_flags::MISSED;
            return self.last;
        };
        let q = theta / self.parameters.gear_ratio;
        self.last = JointAngles {
            theta,
            q,
            aligned_theta: theta,
            aligned_q: q,
            torsion: 0.0,
            flags: match taken {
                Taken::Used => 0,
                Taken::Missed => measured_flags::MISSED,
                Taken::Jumped => measured_flags::JUMP,
            },
        };
        self.last
    }

    /// Reads both angles at one instant: that of the encoder which is sampled first.
    fn align(&mut self, theta: f64, q: f64, flags: u32) -> JointAngles {
        let (thetas, qs) = self
            .history
            .get_or_insert((History::filled(theta), History::filled(q)));
        thetas.push(theta);
        qs.push(q);
        if flags != 0 && self.last.flags & measured_flags::NEVER == 0 {
            // One angle is fresh and the other is not: their difference would be motion, not
            // torsion, so the pair is held.
            return JointAngles {
                theta,
                q,
                flags,
                ..self.last
            };
        }
        let skew = self.parameters.skew / self.parameters.sample_period;
        let aligned_theta = if skew > 0.0 { thetas.ago(skew) } else { theta };
        let aligned_q = if skew < 0.0 { qs.ago(-skew) } else { q };
        let torsion = aligned_theta / self.parameters.gear_ratio - aligned_q;
        JointAngles {
            theta,
            q,
            aligned_theta,
            aligned_q,
            torsion,
            flags,
        }
    }
}
