//! What is known of an actuator, and what leaves for the loop's messages to it.

use super::{
    ASK_ID, Actuator, BEAR, BEARS, COMMAND, CONTROL, DISABLE, ENABLE, RESET, Report, SILENT_NS,
    STATE, STATE_LEN, UNKNOWN,
};
use crate::family::packing::{count, number};
use crate::family::{Family, Feedback, Heard, SetPoint, State};
use can_codec::{Frame, Frames};

/// Frames that one message of the loop becomes, at most: those before enabling, and the enabling one.
pub(super) const MOST: usize = 5;
/// Cycles from one question for what no other answer tells to the next.
pub(super) const POLL_EVERY: u32 = 20;
/// Time after which temperature and voltage count as not told any more, ns: a few of the slowest rates that
/// makers preset.
const OLD_NS: u64 = 2_000_000_000;
/// States that an actuator that tells its state apart has to tell before it is enabled once more: the
/// first may have been on its way already.
const TELLINGS: u8 = 2;

/// Time constant of the mean of its torque that it goes on with where it is to bear its joint, ns: a drive that goes
/// astray is found within some 0.03 s, a tenth of it. Chosen; no experiment recorded.
const BORNE_NS: f64 = 0.3e9;
/// Error of position, rad, by whose torque an actuator's may differ from the one that it is to bear its joint with.
/// Chosen; no experiment recorded.
const BORNE_WAY: f64 = 0.015;

/// A value that is told now and then.
#[derive(Clone, Copy)]
struct Told {
    value: f64,
    at_ns: u64,
}

impl Told {
    const NOT: Self = Self {
        value: f64::NAN,
        at_ns: 0,
    };

    fn note(&mut self, value: Option<f64>, now: u64) {
        if let Some(value) = value {
            *self = Self { value, at_ns: now };
        }
    }

    /// The value; NaN: not told, or too long ago.
    fn now(self, now: u64) -> f64 {
        let is_old = now.saturating_sub(self.at_ns) > OLD_NS;
        if is_old { f64::NAN } else { self.value }
    }
}

/// Whose frame one from the bus is.
pub(super) enum Whose {
    /// Not this actuator's.
    Others,
    /// This actuator's, without a position: its values are kept, and the loop has no message for it.
    Own,
    /// This actuator's, turned into its message of state.
    Message,
}

/// An actuator.
pub(super) struct Live {
    setting: Actuator,
    family: &'static dyn Family,
    /// What it counts for the output's one.
    ratio: f64,
    state: State,
    /// When state and current were told, ns.
    told_ns: u64,
    current_ns: u64,
    heard: Heard,
    error: u32,
    /// Of the output, rad, rad/s and N·m.
    position: f64,
    velocity: f64,
    torque: Option<f64>,
    current: Option<f64>,
    /// Mean of its torque while it followed set-points, N·m of the output, and when it was reported last, ns.
    borne: Option<(f64, u64)>,
    temperature: Told,
    voltage: Told,
    /// The last control word.
    word: u32,
    /// States to be told before it is enabled once more.
    awaited: u8,
    /// It was enabled since it was last disabled.
    enabled: bool,
    /// Cycles.
    cycles: u32,
    /// The set-point's frame of this cycle or the last one.
    last: Option<Frame>,
}

impl Live {
    pub(super) fn new(setting: &Actuator, family: &'static dyn Family) -> Self {
        Self {
            setting: setting.clone(),
            family,
            ratio: setting.ratio(family),
            state: State::Off,
            told_ns: 0,
            current_ns: 0,
            heard: Heard::default(),
            error: 0,
            position: 0.0,
            velocity: 0.0,
            torque: None,
            current: None,
            borne: None,
            temperature: Told::NOT,
            voltage: Told::NOT,
            word: DISABLE,
            awaited: 0,
            enabled: false,
            cycles: 0,
            last: None,
        }
    }

    pub(super) fn report(&self) -> Report {
        Report {
            heard: self.heard,
            error: self.error,
            temperature: Some(self.temperature.value).filter(|x| x.is_finite()),
            voltage: Some(self.voltage.value).filter(|x| x.is_finite()),
        }
    }

    /// Takes a frame from the bus, and turns it into the message of state if it has this actuator's position.
    pub(super) fn receive(&mut self, frame: &mut Frame) -> Whose {
        let setting = &self.setting;
        if frame.bus != setting.at.bus {
            return Whose::Others;
        }
        let told = (self.family).feedback(setting.at, &setting.model, frame);
        let Some(told) = told else {
            return Whose::Others;
        };
        self.note(&told, frame.stamp_ns);
        let is_complete = !self.family.tells_apart()
            || self.heard.current && frame.stamp_ns.saturating_sub(self.current_ns) <= SILENT_NS;
        if told.position.is_none() || !is_complete {
            return Whose::Own;
        }
        *frame = self.message(frame.stamp_ns);
        Whose::Message
    }

    /// Its message of state, of a frame that came at `now`.
    fn message(&self, now: u64) -> Frame {
        let setting = &self.setting;
        let count = (self.position / setting.count()).round_ties_even();
        let velocity = (self.velocity * setting.gear_ratio) as f32;
        let of_torque = self.torque.unwrap_or(0.0) / setting.torque_per_current;
        let current = self.current.unwrap_or(of_torque) as f32;
        let torque = self.torque.unwrap_or(f64::NAN) as f32;
        let mut made = Frame::zeroed(setting.at.bus, setting.id(STATE), STATE_LEN, true);
        made.stamp_ns = now;
        let words = [
            (count as i32).to_le_bytes(),
            velocity.to_le_bytes(),
            current.to_le_bytes(),
            self.status(now).to_le_bytes(),
            torque.to_le_bytes(),
            (self.temperature.now(now) as f32).to_le_bytes(),
            (self.voltage.now(now) as f32).to_le_bytes(),
            self.error.to_le_bytes(),
        ];
        for (place, word) in made.data.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word);
        }
        made
    }

    fn note(&mut self, told: &Feedback, now: u64) {
        self.error = told.error.unwrap_or(self.error);
        if let Some(state) = told.state.or_else(|| self.likely_state(told)) {
            (self.state, self.told_ns, self.heard.state) = (state, now, true);
            self.awaited = self.awaited.saturating_sub(1);
        }
        if let Some(position) = told.position {
            (self.position, self.heard.position) = (position / self.ratio, true);
        }
        if let Some(current) = told.current {
            (self.current, self.current_ns, self.heard.current) = (Some(current), now, true);
        }
        self.velocity = (told.velocity).map_or(self.velocity, |x| x / self.ratio);
        self.torque = told.torque.map(|x| x * self.ratio).or(self.torque);
        self.note_borne(now);
        self.temperature.note(told.temperature, now);
        self.voltage.note(told.voltage, now);
    }

    fn note_borne(&mut self, now: u64) {
        let follows = self.word == ENABLE && self.state == State::Enabled;
        self.borne = match (self.borne, self.torque.filter(|x| x.is_finite())) {
            (None, Some(torque)) if follows => Some((torque, now)),
            (Some((mean, then)), Some(torque)) if follows => {
                let passed = now.saturating_sub(then) as f64;
                let most = self.greatest_difference();
                // One that runs away does not change it by much.
                let change = (torque - mean).max(-most).min(most);
                Some((mean + change * passed / (BORNE_NS + passed), now))
            }
            (borne, _) if self.word == BEAR => borne,
            _ => None,
        };
    }

    /// The state of an actuator that does not tell it, and answers.
    fn likely_state(&self, told: &Feedback) -> Option<State> {
        if self.family.tells_whether_on() || told.position.is_none() {
            None
        } else if self.error != 0 {
            Some(State::Fault)
        } else if self.enabled {
            Some(State::Enabled)
        } else {
            Some(State::Off)
        }
    }

    fn status(&self, now: u64) -> u32 {
        let state = match self.state {
            _ if now.saturating_sub(self.told_ns) > SILENT_NS => UNKNOWN,
            State::Off => 0,
            State::Enabled if self.word == BEAR && self.bears() => BEARS,
            State::Enabled => 1,
            State::Fault => 2,
            State::Busy => UNKNOWN,
        };
        state | self.error << 8
    }

    /// Appends what leaves for a frame of the loop.
    pub(super) fn send(&mut self, frame: &Frame, out: &mut Frames) {
        if frame.bus != self.setting.at.bus {
        } else if frame.id == ASK_ID {
            push(out, self.ask());
            self.cycles = self.cycles.wrapping_add(1);
            if self.family.polls_apart() && self.cycles.is_multiple_of(POLL_EVERY) {
                push(out, self.family.poll(self.setting.at));
            }
        } else if frame.id == self.setting.id(COMMAND) {
            push(out, self.command(frame));
        } else if frame.id == self.setting.id(CONTROL) {
            self.control(frame, out);
        }
    }

    /// Once in a cycle: the last set-point again, if there was one since the last time, or else what
    /// cannot move anything.
    fn ask(&mut self) -> Option<Frame> {
        let again = self.last.take();
        if self.word == BEAR && self.state == State::Enabled {
            return self.bear();
        }
        if self.family.tells_apart() {
            // It sends by itself.
            return None;
        }
        again.or_else(|| self.family.idle(self.setting.at, &self.setting.model))
    }

    /// The torque of before, N·m of the output.
    fn borne(&self) -> f64 {
        self.borne.map_or(0.0, |(torque, _)| torque)
    }

    /// Its torque is that of before less its damping, as far as it reports one.
    fn bears(&self) -> bool {
        let asked = self.borne() - self.setting.kd * self.velocity;
        (self.torque).is_none_or(|torque| (torque - asked).abs() <= self.greatest_difference())
    }

    /// Difference of two torques that is more than an actuator's error, N·m of the output.
    fn greatest_difference(&self) -> f64 {
        BORNE_WAY * self.setting.kp
    }

    /// It goes on with its torque of before, damped by its own gain.
    fn bear(&self) -> Option<Frame> {
        let damped = SetPoint {
            kp: 0.0,
            torque: self.borne() / self.ratio,
            ..self.set_point(self.position)
        };
        let setting = &self.setting;
        (self.family).command(setting.at, &setting.model, &damped)
    }

    /// Of the output's numbers, what the family counts.
    fn set_point(&self, position: f64) -> SetPoint {
        let softer = self.ratio * self.ratio;
        SetPoint {
            position: position * self.ratio,
            kp: self.setting.kp / softer,
            kd: self.setting.kd / softer,
            ..SetPoint::default()
        }
    }

    /// What counting takes from a position, rad of what the family counts. It goes as torque in the same frame, whose
    /// counts are finer: 16 bits of ±12.5 rad are steps of 0.08 N·m at 200 N·m/rad, 12 bits of ±28 N·m of 0.014.
    /// Beyond the range's ends nothing makes it up.
    fn remainder(&self, position: f64) -> f64 {
        let range = self.setting.model.position;
        if !self.setting.counts() || position.abs() > range {
            return 0.0;
        }
        position - number(count(position, -range, range, 16), -range, range, 16)
    }

    fn command(&mut self, frame: &Frame) -> Option<Frame> {
        let bytes = frame.data.first_chunk::<8>()?;
        // Nothing but what is asked for while it is off.
        if self.word != ENABLE {
            return None;
        }
        let mut set_point = self.set_point(f64::from_le_bytes(*bytes));
        let setting = &self.setting;
        set_point.torque = set_point.kp * self.remainder(set_point.position);
        self.last = (self.family).command(setting.at, &setting.model, &set_point);
        self.last
    }

    fn control(&mut self, frame: &Frame, out: &mut Frames) {
        let Some(bytes) = frame.data.first_chunk::<4>() else {
            return;
        };
        // Only one that follows set-points has a torque to go on with.
        let follows = matches!(self.word, ENABLE | BEAR) && self.state == State::Enabled;
        let word = match u32::from_le_bytes(*bytes) {
            BEAR if !follows || !self.family.commands_gains() => DISABLE,
            word => word,
        };
        let is_new = word != self.word;
        self.word = word;
        if is_new {
            self.awaited = 0;
        }
        if word != ENABLE {
            (self.last, self.enabled) = (None, self.enabled && word == BEAR);
        }
        let at = self.setting.at;
        match (word, self.state) {
            // A state that is told seldom may be that before the last word.
            (ENABLE, State::Enabled | State::Busy) | (BEAR, State::Enabled) => {}
            (DISABLE, State::Off) if !is_new => {}
            (ENABLE, _) => self.enable(out),
            (RESET, _) => push(out, Some(self.family.clear(at))),
            _ => push(out, Some(self.family.disable(at))),
        }
    }

    fn enable(&mut self, out: &mut Frames) {
        if self.awaited > 0 {
            return;
        }
        if self.family.tells_apart() {
            self.awaited = TELLINGS;
        }
        let setting = &self.setting;
        let hold = self.set_point(self.position);
        let before = self.family.prepare(setting.at, &setting.model, &hold);
        before.into_iter().for_each(|frame| push(out, frame));
        push(out, Some(self.family.enable(setting.at)));
        self.enabled = true;
    }
}

fn push(out: &mut Frames, frame: Option<Frame>) {
    if let Some(frame) = frame {
        out.push(frame);
    }
}
