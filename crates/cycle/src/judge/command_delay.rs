//! Delay of commands, as measured: how many periods after a command the motor's current shows it.
//!
//! In: the commands that were sent, motor-side angles and currents, while a client is followed. Out: for each
//! joint the delay from the sample that a command is computed from to its effect, with its standard
//! deviation. One joint at a time, for a second, or up to four where that is not enough: the current is
//! predicted from everything before it, and from the angle of its own sample,
//!
//! ```text
//! i(k) = sum_j g_j u(k-j) + sum_m a_m i(k-m) + sum_m b_m x(k-m) + c + e(k)
//! h_j  = g_j + sum_(m<j) a_m h_(j-m)                     response to a command j periods before
//! ```
//!
//! The commands answer angles and currents, with their noise: a regression on commands alone takes that for
//! an effect of the next command. What is left with all of the past as regressors, `e(k)`, no command
//! has seen, and the `h_j` are those of the drive. What their errors have besides (a dead zone in which the
//! drive does not answer, counts of encoder and current, friction that sticks) is correlated from cycle to
//! cycle, so standard deviations are not those of independent samples: the time is cut into blocks, and
//! leaving out each in turn (the jackknife) shows how far the result depends on it.
//!
//! A delay is known where one `h_j` exceeds zero and all others that are not its neighbours, by
//! [`KNOWN`] standard deviations, and the centre of it and its neighbours is known to a fraction of a period.
//! It acts up to a period before, so what is found is the delay in whole periods, and parts of one only
//! where it varies from one time to the next; `torquectl identify drive` finds parts from a motion that
//! excites the drive. Here whatever the client asks for has to do: torque control answers the noise of
//! the link's encoder in every cycle, which is often enough; a held set-point shows nothing.

use nalgebra::{SMatrix, SVector};
use robot_config::{JointParameters, Robot};
use robot_state::{CommandedRecord, Event, MeasuredRecord, command_flags, measured_flags};
use supervisor::count_in_a_row;

use crate::events::{Counts, Subject};
use crate::joint::Gap;
use crate::measure::NOT_USED;

/// Most periods after which a command shows that are looked for; angles before the newest, and currents.
const PERIODS: usize = 6;
const ANGLES: usize = 6;
const CURRENTS: usize = 4;
/// Commands, currents, changes of the angle, the oldest angle, c.
const TERMS: usize = PERIODS + CURRENTS + ANGLES + 2;
/// Blocks of a measurement, an even number.
const BLOCKS: usize = 10;
/// Least and greatest time of a block, s: longer than what the loop's answers last. Chosen; no experiment recorded.
const BLOCK_S: [f64; 2] = [0.1, 0.4];
/// Standard deviations by which a response differs from zero and from those of other periods. Of ten blocks they are
/// uncertain by a quarter: four of them are at least three true ones.
const KNOWN: f64 = 4.0;
/// Greatest share of the greatest response that another period may have, but for the neighbours.
/// Chosen; no experiment recorded.
const OTHER: f64 = 0.5;
/// Greatest standard deviation of the centre, periods. Chosen; no experiment recorded.
const CENTRE: f64 = 0.2;
/// Variance of where in a period a command acts, periods²: that of a uniform distribution.
const WITHIN: f64 = 1.0 / 12.0;
/// Periods that the measured delay may leave the range that the configured one explains.
/// Chosen; no experiment recorded.
const SLACK: f64 = 0.25;
/// Standard deviations of the measured delay's centre besides [`SLACK`]: one of 370 measurements of a normal
/// distribution is beyond three.
const SIGMAS: f64 = 3.0;
/// Measurements in a row of another delay than configured that raise the event: a burst of lost commands is
/// none.
const IN_A_ROW: u32 = 2;
/// Share of earlier measurements' weight that is left with the next one of the joint. Chosen; no experiment recorded.
const KEPT: f64 = 0.7;

type Matrix = SMatrix<f64, TERMS, TERMS>;
type Vector = SVector<f64, TERMS>;
type Responses = [f64; PERIODS];

#[derive(Debug, Clone, Copy)]
struct Joint {
    /// Delay that is configured, from the joint's sample, and age of the sample at SYNC, s.
    configured: f64,
    latency: f64,
    per_turn: f64,
    /// Commands are positions.
    takes_position: bool,
    /// Mean of the periods found, number of measurements that it stands for, variance of the mean by that
    /// of each, and mean square of their distances from it.
    periods: f64,
    weight: f64,
    variance: f64,
    scatter: f64,
    off: u32,
}

/// One measurement: periods after which commands show in the mean, less half of one, with its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    periods: f64,
    variance: f64,
}

/// Normal equations of one block.
#[derive(Debug, Clone, Copy)]
struct Sums {
    normal: Matrix,
    right: Vector,
}

impl Sums {
    const ZERO: Self = Self {
        normal: Matrix::from_array_storage(nalgebra::ArrayStorage([[0.0; TERMS]; TERMS])),
        right: Vector::from_array_storage(nalgebra::ArrayStorage([[0.0; TERMS]])),
    };
}

/// The delay of all joints' commands.
#[derive(Debug)]
pub(crate) struct CommandDelay {
    joints: Vec<Joint>,
    period: f64,
    /// Samples of a block, at the begin and now.
    least_block: usize,
    block: usize,
    /// The joint that is being measured.
    joint: usize,
    samples: usize,
    /// Commands, angles and currents of the last cycles, newest first, and how many of them count.
    commands: [f64; PERIODS],
    angles: [f64; ANGLES + 1],
    currents: [f64; CURRENTS],
    kept: usize,
    /// Command, angle and current from which the regressors count.
    origin: Option<[f64; 3]>,
    blocks: Vec<Sums>,
    jackknife: Jackknife,
}

impl CommandDelay {
    pub(crate) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let joint = |joint: &JointParameters| Joint {
            configured: joint.law.delay,
            latency: joint.sampling.latency,
            per_turn: joint.encoders.gear_ratio.recip(),
            takes_position: joint.takes_position(),
            periods: 0.0,
            weight: 0.0,
            variance: 0.0,
            scatter: 0.0,
            off: 0,
        };
        let period = p.timing.sample_period;
        let block = ((BLOCK_S[0] / period).round() as usize).max(2 * TERMS);
        Self {
            joints: p.joints.iter().map(joint).collect(),
            period,
            least_block: block,
            block,
            joint: 0,
            samples: 0,
            commands: [0.0; PERIODS],
            angles: [0.0; ANGLES + 1],
            currents: [0.0; CURRENTS],
            kept: 0,
            origin: None,
            blocks: vec![Sums::ZERO; BLOCKS],
            jackknife: Jackknife::default(),
        }
    }

    /// Takes a cycle, in which a mode is followed or not, and writes what is known into the record.
    pub(crate) fn update(
        &mut self,
        follows: bool,
        gap: Gap,
        measured: &MeasuredRecord,
        commanded: &mut CommandedRecord,
        counts: &mut Counts,
    ) {
        // The record of a joint is made anew in each cycle.
        for (shown, joint) in commanded.joints.iter_mut().zip(&self.joints) {
            if joint.weight > 0.0 {
                (shown.command_delay_s, shown.command_delay_sigma_s) = joint.delay(self.period);
            }
        }
        if self.samples >= BLOCKS * self.block {
            self.evaluate(counts);
            return;
        }
        let (Some(joint), Some(sample), Some(sent)) = (
            self.joints.get(self.joint),
            measured.joints.get(self.joint),
            commanded.joints.get(self.joint),
        ) else {
            return;
        };
        let fresh = sample.flags & (NOT_USED | measured_flags::STALE) == 0;
        let engaged = sent.flags & command_flags::ENGAGED != 0;
        if !follows || gap != Gap::None || !fresh || !engaged {
            self.kept = 0;
            return;
        }
        let angle = sample.theta * joint.per_turn;
        if joint.takes_position {
            // The offset from the motor: small numbers.
            self.take(sent.q_c - angle, angle, sample.current);
        } else {
            self.take(sent.current_c, angle, sample.current);
        }
    }

    /// The command of a cycle acts after its sample: it is the newest that a later one can show.
    fn take(&mut self, command: f64, angle: f64, current: f64) {
        let [command_0, angle_0, current_0] = *self.origin.get_or_insert([command, angle, current]);
        self.angles.rotate_right(1);
        self.angles[0] = angle - angle_0;
        if self.kept > ANGLES
            && let Some(sums) = self.blocks.get_mut(self.samples / self.block)
        {
            let mut terms = Vector::zeros();
            let angles = self.angles.windows(2).map(|pair| pair[0] - pair[1]);
            let rest = [self.angles[ANGLES], 1.0];
            let all = (self.commands.into_iter().chain(self.currents)).chain(angles.chain(rest));
            terms.iter_mut().zip(all).for_each(|(term, x)| *term = x);
            sums.normal.syger(1.0, &terms, &terms, 1.0);
            sums.right += terms * (current - current_0);
            self.samples += 1;
        }
        self.commands.rotate_right(1);
        self.commands[0] = command - command_0;
        self.currents.rotate_right(1);
        self.currents[0] = current - current_0;
        self.kept += 1;
    }

    /// A step of the evaluation, one solution a cycle; then the next joint's turn.
    fn evaluate(&mut self, counts: &mut Counts) {
        let found = match self.jackknife.step(&self.blocks) {
            Progress::Goes => return,
            Progress::Ends(found) => found,
        };
        (self.kept, self.jackknife) = (0, Jackknife::default());
        if found.is_none() && self.goes_on() {
            return;
        }
        if let Some(found) = found
            && let Some(joint) = self.joints.get_mut(self.joint)
        {
            joint.learn(found, self.period);
            if joint.off >= IN_A_ROW {
                counts.add_of(Event::CommandDelay, Subject::Joint(self.joint));
            }
        }
        self.joint = match self.joint + 1 {
            next if next < self.joints.len() => next,
            _ => 0,
        };
        (self.samples, self.origin, self.block) = (0, None, self.least_block);
        self.blocks.fill(Sums::ZERO);
    }

    /// Joins the blocks in pairs, so that as many are free again; false where they are long already.
    fn goes_on(&mut self) -> bool {
        let longer = 2 * self.block;
        if longer as f64 * self.period > BLOCK_S[1] + 0.5 * self.period {
            return false;
        }
        for b in 0..BLOCKS / 2 {
            let pair = (self.blocks.get(2 * b), self.blocks.get(2 * b + 1));
            let (Some(first), Some(second)) = pair else {
                return false;
            };
            let joined = Sums {
                normal: first.normal + second.normal,
                right: first.right + second.right,
            };
            if let Some(block) = self.blocks.get_mut(b) {
                *block = joined;
            }
        }
        let free = self.blocks.iter_mut().skip(BLOCKS / 2);
        free.for_each(|block| *block = Sums::ZERO);
        (self.block, self.samples) = (longer, BLOCKS / 2 * longer);
        true
    }
}

impl Joint {
    /// Delay and its standard deviation, s. A command that shows after `n` periods acts up to one before.
    fn delay(&self, period: f64) -> (f64, f64) {
        let delay = period * (self.periods - 0.5) - self.latency;
        let variance = WITHIN + self.variance.max(self.scatter / self.weight.max(1.0));
        (delay, period * variance.sqrt())
    }

    fn learn(&mut self, found: Found, period: f64) {
        let configured = (self.configured + self.latency) / period;
        let slack = SLACK + SIGMAS * found.variance.sqrt();
        let range = configured - slack..=configured + 1.0 + slack;
        count_in_a_row(&mut self.off, !range.contains(&found.periods));
        let before = KEPT * self.weight;
        self.weight = before + 1.0;
        let share = self.weight.recip();
        let off = found.periods - self.periods;
        let off = if before > 0.0 { off } else { 0.0 };
        self.scatter = (1.0 - share) * (self.scatter + share * off * off);
        self.variance = (1.0 - share).powi(2) * self.variance + share * share * found.variance;
        self.periods += (found.periods - self.periods) * share;
    }
}

enum Progress {
    Goes,
    Ends(Option<Found>),
}

/// The responses by all blocks, then without each of them.
#[derive(Debug, Clone, Default)]
struct Jackknife {
    whole: Option<Responses>,
    without: [Responses; BLOCKS],
    done: usize,
}

impl Jackknife {
    fn step(&mut self, blocks: &[Sums]) -> Progress {
        let left_out = self.whole.map(|_| self.done);
        let mut sums = Sums::ZERO;
        for (b, block) in blocks.iter().enumerate() {
            if left_out != Some(b) {
                sums.normal += block.normal;
                sums.right += block.right;
            }
        }
        let Some(found) = responses(&sums) else {
            return Progress::Ends(None);
        };
        let Some(whole) = self.whole else {
            self.whole = Some(found);
            return Progress::Goes;
        };
        if let Some(without) = self.without.get_mut(self.done) {
            *without = found;
        }
        self.done += 1;
        if self.done < BLOCKS {
            Progress::Goes
        } else {
            Progress::Ends(self.found(&whole))
        }
    }

    /// Standard deviation of a quantity that follows from responses.
    fn sigma(&self, of: impl Fn(&Responses) -> f64) -> f64 {
        let n = BLOCKS as f64;
        let mean = self.without.iter().map(&of).sum::<f64>() / n;
        let square = self.without.iter().map(|h| (of(h) - mean).powi(2));
        (square.sum::<f64>() * (n - 1.0) / n).sqrt()
    }

    fn found(&self, whole: &Responses) -> Option<Found> {
        let (best, height) = greatest(whole);
        let exceeds = |of: &dyn Fn(&Responses) -> f64| of(whole) > KNOWN * self.sigma(of);
        if !(height.is_finite() && exceeds(&|h| h[best])) {
            return None;
        }
        let others = (0..PERIODS).filter(|j| j.abs_diff(best) > 1);
        for j in others {
            if whole[j] > OTHER * height || !exceeds(&|h| h[best] - h[j]) {
                return None;
            }
        }
        let centre = |h: &Responses| {
            let near = best.saturating_sub(1)..=(best + 1).min(PERIODS - 1);
            let (mut sum, mut moment) = (0.0, 0.0);
            for j in near {
                sum += h[j].max(0.0);
                moment += h[j].max(0.0) * (j + 1) as f64;
            }
            moment / sum.max(f64::MIN_POSITIVE)
        };
        let sigma = self.sigma(centre);
        (sigma < CENTRE).then(|| Found {
            periods: centre(whole),
            variance: sigma * sigma,
        })
    }
}

/// Place and value of the greatest response.
fn greatest(h: &Responses) -> (usize, f64) {
    let mut best = (0, f64::NEG_INFINITY);
    for (j, &x) in h.iter().enumerate() {
        if x > best.1 {
            best = (j, x);
        }
    }
    best
}

/// `h_j` by least squares; none where the equations do not determine them.
fn responses(sums: &Sums) -> Option<Responses> {
    let scale = Vector::from_fn(|i, _| sums.normal[(i, i)].max(f64::MIN_POSITIVE).sqrt());
    let matrix = Matrix::from_fn(|i, k| {
        let ridge = if i == k { 1e-9 } else { 0.0 };
        sums.normal[(i.max(k), i.min(k))] / (scale[i] * scale[k]) + ridge
    });
    let mut found = matrix
        .cholesky()?
        .solve(&sums.right.component_div(&scale))
        .component_div(&scale);
    // h in place of g.
    for j in 0..PERIODS {
        let earlier = (1..=CURRENTS.min(j)).map(|m| found[PERIODS + m - 1] * found[j - m]);
        found[j] += earlier.sum::<f64>();
    }
    Some(std::array::from_fn(|j| found[j]))
}
