//! State of the screen: what was seen, and what the user wants to see of it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};
use torqued_client::Record;
use torqued_client::robot_state::{
    CycleRecord, Description, Event, JointEstimated, LoopRecord, TorqueEstimate, torque_flags,
};

/// Time that a line of the past shows, and its parts.
pub(super) const PAST: Duration = Duration::from_secs(10);
pub(super) const PARTS: usize = 20;
/// Events that are kept.
const KEPT: usize = 50;
/// Time without a record from which on that is said.
const SILENT: Duration = Duration::from_secs(1);

/// What a key asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    /// End.
    Quit,
    Char(char),
    Up,
    Down,
    Enter,
    Escape,
    Backspace,
}

/// Torque that is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shown {
    Hat,
    Encoder,
    WholeBody,
    Current,
}

impl Shown {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Hat => "tau_hat",
            Self::Encoder => "encoder",
            Self::WholeBody => "whole-body",
            Self::Current => "current",
        }
    }

    fn next(self) -> Self {
        match self {
            Self::Hat => Self::Encoder,
            Self::Encoder => Self::WholeBody,
            Self::WholeBody => Self::Current,
            Self::Current => Self::Hat,
        }
    }

    pub(super) fn of(self, joint: &JointEstimated) -> &TorqueEstimate {
        match self {
            Self::Hat => &joint.tau_hat,
            Self::Encoder => &joint.tau_encoder,
            Self::WholeBody => &joint.tau_whole_body,
            Self::Current => &joint.tau_current,
        }
    }
}

/// Order of the joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Robot,
    Name,
    Load,
    Error,
}

impl Order {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Robot => "as configured",
            Self::Name => "by name",
            Self::Load => "by share of the limit",
            Self::Error => "by torque error",
        }
    }

    fn next(self) -> Self {
        match self {
            Self::Robot => Self::Name,
            Self::Name => Self::Load,
            Self::Load => Self::Error,
            Self::Error => Self::Robot,
        }
    }
}

/// A joint's past.
#[derive(Debug, Clone, Default)]
pub(super) struct Past {
    /// Mean torques of the parts that are over, newest last, N·m; none where none was valid.
    pub(super) parts: VecDeque<Option<f64>>,
    /// Sum and number of the torques of the part that has begun.
    begun: (f64, u32),
    /// Least and greatest torque since the start or the last reset, N·m.
    pub(super) extremes: Option<(f64, f64)>,
}

impl Past {
    fn take(&mut self, tau: Option<f64>) {
        let Some(tau) = tau else { return };
        self.begun = (self.begun.0 + tau, self.begun.1 + 1);
        let (low, high) = self.extremes.unwrap_or((tau, tau));
        self.extremes = Some((low.min(tau), high.max(tau)));
    }

    fn end_part(&mut self) {
        if self.parts.len() == PARTS {
            self.parts.pop_front();
        }
        let (sum, count) = std::mem::take(&mut self.begun);
        let mean = (count > 0).then(|| sum / f64::from(count));
        self.parts.push_back(mean);
    }
}

/// An event that occurred while the screen was there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Occurred {
    /// The robot's clock, s.
    pub(super) at_s: f64,
    pub(super) event: Event,
    /// How often in that record.
    pub(super) times: u64,
}

/// Everything on the screen.
pub(super) struct Model {
    pub(super) description: Description,
    pub(super) cycle: Option<Box<CycleRecord>>,
    pub(super) timing: LoopRecord,
    pub(super) pasts: Vec<Past>,
    pub(super) events: VecDeque<Occurred>,
    /// Records that came too quickly for the screen.
    pub(super) lost: u64,
    pub(super) shown: Shown,
    pub(super) order: Order,
    /// Text that a joint's name must contain, and whether it is being typed.
    pub(super) filter: String,
    pub(super) typing: bool,
    /// The picture stands.
    pub(super) held: bool,
    pub(super) helps: bool,
    /// F/T sensors are shown in place of the events.
    pub(super) sensors: bool,
    /// Row of the joint that is shown in full.
    pub(super) selected: usize,
    last: Option<(Instant, [u64; robot_events()])>,
    part_began: Option<Instant>,
}

const fn robot_events() -> usize {
    torqued_client::robot_state::EVENT_COUNT
}

impl Model {
    pub(super) fn new(description: &Description) -> Self {
        Self {
            description: *description,
            cycle: None,
            timing: LoopRecord::default(),
            pasts: vec![Past::default(); description.joint_count as usize],
            events: VecDeque::with_capacity(KEPT),
            lost: 0,
            shown: Shown::Hat,
            order: Order::Robot,
            filter: String::new(),
            typing: false,
            held: false,
            helps: false,
            sensors: false,
            selected: 0,
            last: None,
            part_began: None,
        }
    }

    /// Takes a record; a picture that stands misses it, but extremes and events do not.
    pub(super) fn take(&mut self, record: &Record, description: &Description, now: Instant) {
        self.lost += record.lost;
        self.take_cycle(&record.cycle, &record.timing, description, now);
    }

    pub(super) fn take_cycle(
        &mut self,
        cycle: &CycleRecord,
        timing: &LoopRecord,
        description: &Description,
        now: Instant,
    ) {
        if *description != self.description {
            // Another daemon, perhaps of another robot.
            let (shown, order) = (self.shown, self.order);
            *self = Self::new(description);
            (self.shown, self.order) = (shown, order);
        }
        let began = *self.part_began.get_or_insert(now);
        let over = now.saturating_duration_since(began) >= PAST / PARTS as u32;
        for (past, joint) in self.pasts.iter_mut().zip(&cycle.estimated.joints) {
            past.take(valid(self.shown.of(joint)).map(|estimate| estimate.tau));
            if over {
                past.end_part();
            }
        }
        if over {
            self.part_began = Some(now);
        }
        self.note_events(cycle);
        self.last = Some((now, cycle.events));
        if !self.held {
            self.timing = *timing;
            let kept = self.cycle.get_or_insert_with(|| Box::new(*cycle));
            **kept = *cycle;
        }
    }

    fn note_events(&mut self, cycle: &CycleRecord) {
        let Some((_, before)) = &self.last else {
            return;
        };
        for &event in Event::ALL {
            let i = event.index();
            let times = cycle.events[i].saturating_sub(before[i]);
            if times == 0 {
                continue;
            }
            let at_s = 1e-9 * cycle.stamp_ns as f64;
            // One that lasts is one line.
            if let Some(last) = self.events.back_mut()
                && last.event == event
                && at_s - last.at_s < 1.0
            {
                last.times += times;
                continue;
            }
            if self.events.len() == KEPT {
                self.events.pop_front();
            }
            self.events.push_back(Occurred { at_s, event, times });
        }
    }

    /// Time without a record, where it is long.
    pub(super) fn silence(&self, now: Instant) -> Option<Duration> {
        let (last, _) = self.last.as_ref()?;
        Some(now.saturating_duration_since(*last)).filter(|silence| *silence > SILENT)
    }

    /// Joints in the order wanted.
    pub(super) fn rows(&self) -> Vec<usize> {
        let name = |j: &usize| self.description.joint_names[*j].as_str();
        let wanted = self.filter.to_lowercase();
        let mut rows: Vec<usize> = (0..self.pasts.len())
            .filter(|j| name(j).to_lowercase().contains(&wanted))
            .collect();
        let Some(cycle) = &self.cycle else {
            return rows;
        };
        let share = |j: &usize| -self.share(cycle, *j).unwrap_or(0.0);
        let error = |j: &usize| {
            let tau = valid(self.shown.of(&cycle.estimated.joints[*j])).map(|e| e.tau);
            -tau.map_or(0.0, |tau| (tau - cycle.commanded.joints[*j].tau_d).abs())
        };
        match self.order {
            Order::Robot => {}
            Order::Name => rows.sort_by_key(|j| name(j).to_owned()),
            Order::Load => rows.sort_by(|a, b| share(a).total_cmp(&share(b))),
            Order::Error => rows.sort_by(|a, b| error(a).total_cmp(&error(b))),
        }
        rows
    }

    /// Share of a joint's torque limit that it carries, 1; none without a valid torque.
    pub(super) fn share(&self, cycle: &CycleRecord, joint: usize) -> Option<f64> {
        let estimate = valid(self.shown.of(&cycle.estimated.joints[joint]))?;
        let limit = self.description.torque_limits[joint];
        (limit > 0.0).then(|| estimate.tau.abs() / limit)
    }

    pub(super) fn press(&mut self, key: Key) {
        if self.typing {
            return self.type_in(key);
        }
        let last = self.rows().len().saturating_sub(1);
        match key {
            Key::Up | Key::Char('k') => self.selected = self.selected.saturating_sub(1),
            Key::Down | Key::Char('j') => self.selected = (self.selected + 1).min(last),
            Key::Char('s') => self.order = self.order.next(),
            Key::Char('t') => {
                self.shown = self.shown.next();
                self.forget();
            }
            Key::Char('r') => self.forget(),
            Key::Char('/') => self.typing = true,
            Key::Char(' ') => self.held = !self.held,
            Key::Char('?' | 'h') => self.helps = !self.helps,
            Key::Char('f') => self.sensors = !self.sensors,
            Key::Escape => {
                self.filter.clear();
                self.helps = false;
            }
            _ => {}
        }
        self.selected = self.selected.min(last);
    }

    /// Whether a key ends the program.
    pub(super) fn ends(&self, key: Key) -> bool {
        key == Key::Quit || (!self.typing && key == Key::Char('q'))
    }

    fn type_in(&mut self, key: Key) {
        match key {
            Key::Char(c) => self.filter.push(c),
            Key::Backspace => _ = self.filter.pop(),
            Key::Enter => self.typing = false,
            Key::Escape => {
                self.filter.clear();
                self.typing = false;
            }
            Key::Quit | Key::Up | Key::Down => {}
        }
        self.selected = 0;
    }

    /// Extremes and lines of the past begin anew.
    fn forget(&mut self) {
        self.pasts.fill(Past::default());
        self.part_began = None;
    }
}

/// An estimate that may be used.
pub(super) fn valid(estimate: &TorqueEstimate) -> Option<&TorqueEstimate> {
    Some(estimate).filter(|e| e.flags & torque_flags::VALID != 0)
}
