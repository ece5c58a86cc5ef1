//! `torquectl watch` on a terminal: a program that draws all joints, and is asked by keys.

mod draw;
mod model;

use super::{Failure, WatchArguments};
use crate::motion::catch_signals;
use crate::requests::connect;
use model::{Key, Model};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use std::io;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use torqued_client::{Client, Error};

/// Longest wait for a key: 128 records are kept for a client, which is 128 ms of 1 kHz.
const READ_EVERY: Duration = Duration::from_millis(20);
/// Pictures a second, at most: a terminal shows no more.
const PICTURES_HZ: f64 = 30.0;

/// Until the user ends it, or a signal does.
pub(super) fn run(arguments: &WatchArguments) -> Result<(), Failure> {
    let mut client = connect(arguments.robot.as_ref())?;
    let stop = catch_signals().map_err(|e| Failure::Output(io::Error::other(e.to_string())))?;
    let mut model = Model::new(client.description());
    let period = Duration::from_secs_f64(1.0 / arguments.rate.min(PICTURES_HZ));
    let mut terminal = ratatui::try_init()?;
    let mut next = Instant::now();
    let ended = loop {
        if let Err(e) = read(&mut client, &mut model) {
            break Err(e.into());
        }
        if Instant::now() >= next {
            if let Err(e) = terminal.draw(|frame| draw::draw(frame, &model)) {
                break Err(e.into());
            }
            next = Instant::now() + period;
        }
        match ask(next
            .saturating_duration_since(Instant::now())
            .min(READ_EVERY))
        {
            Ok(None) if stop.load(Ordering::Relaxed) => break Ok(()),
            Ok(None) => {}
            Ok(Some(key)) if model.ends(key) => break Ok(()),
            Ok(Some(key)) => {
                model.press(key);
                next = Instant::now();
            }
            Err(e) => break Err(e.into()),
        }
    };
    ratatui::restore();
    ended
}

/// Takes every record that has arrived.
fn read(client: &mut Client, model: &mut Model) -> Result<(), Error> {
    loop {
        match client.next_record(Duration::ZERO) {
            Ok(record) => model.take(&record, client.description(), Instant::now()),
            Err(Error::NoRecord { .. }) => return Ok(()),
            Err(e) => return Err(e),
        }
    }
}

/// What the user asks for within some time.
fn ask(within: Duration) -> io::Result<Option<Key>> {
    if !event::poll(within)? {
        return Ok(None);
    }
    Ok(match event::read()? {
        Event::Key(key) if key.kind != KeyEventKind::Release => Key::of(&key),
        _ => None,
    })
}

impl Key {
    /// A key of the keyboard.
    fn of(key: &KeyEvent) -> Option<Self> {
        let control = key.modifiers.contains(KeyModifiers::CONTROL);
        Some(match key.code {
            KeyCode::Char('c') if control => Self::Quit,
            KeyCode::Char(c) => Self::Char(c),
            KeyCode::Up => Self::Up,
            KeyCode::Down => Self::Down,
            KeyCode::Enter => Self::Enter,
            KeyCode::Esc => Self::Escape,
            KeyCode::Backspace => Self::Backspace,
            _ => return None,
        })
    }
}
