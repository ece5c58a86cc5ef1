//! The screen's picture.

use super::model::{Model, Occurred, PARTS, Past, Shown, valid};
use crate::watch::text;
use crate::words;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Cell, Clear, Paragraph, Row, Table, TableState, Wrap};
use std::time::Instant;
use torqued_client::robot_state::{CycleRecord, TorqueEstimate};

const HELP: &str = "\
up, down   a joint in full      s  order of the joints
t          torque that is shown /  only joints whose names contain a text (Enter, Esc)
space      hold the picture     r  forget least and greatest
f          F/T sensors, events  ?  these lines
q          end

A bar is the share of the torque limit, the line beside it the last 10 s, from least to greatest.";
/// Cells of a bar.
const BAR: usize = 10;
/// Events that are shown.
const EVENTS: u16 = 5;

pub(super) fn draw(frame: &mut Frame<'_>, model: &Model) {
    let [head, joints, full, events, foot] = Layout::vertical([
        Constraint::Length(4),
        Constraint::Min(4),
        Constraint::Length(4),
        Constraint::Length(EVENTS + 1),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    let Some(cycle) = &model.cycle else {
        frame.render_widget(Paragraph::new("waiting for the first record"), head);
        return;
    };
    frame.render_widget(heading(model, cycle), head);
    draw_joints(frame, model, cycle, joints);
    frame.render_widget(in_full(model, cycle), full);
    let below = if model.sensors {
        Paragraph::new(text::ft_sensors(&model.description, cycle).to_string())
    } else {
        last_events(model)
    };
    frame.render_widget(below, events);
    frame.render_widget(bottom(model), foot);
    if model.helps {
        let area = centred(frame.area(), 92, 10);
        frame.render_widget(Clear, area);
        let block = Block::bordered().title(" keys ");
        frame.render_widget(Paragraph::new(HELP).block(block), area);
    }
}

fn strong() -> Style {
    Style::default().add_modifier(Modifier::BOLD)
}

fn reversed() -> Style {
    Style::default().add_modifier(Modifier::REVERSED)
}

fn heading(model: &Model, cycle: &CycleRecord) -> Paragraph<'static> {
    let description = &model.description;
    let timing = &model.timing;
    let mut first = vec![
        Span::styled(description.robot.to_string(), strong()),
        Span::raw(format!(
            ": {}, mode {}, contact set {}; cycles {}, late {}, skipped {}; computed {:.0} us",
            words::state(cycle.state),
            words::mode(cycle.mode),
            words::contact_set(description, cycle),
            timing.cycles,
            timing.late_cycles,
            timing.skipped_cycles,
            1e-3 * timing.compute_ns as f64,
        )),
    ];
    if let Some(silence) = model.silence(Instant::now()) {
        let text = format!("  no record for {:.0} s ", silence.as_secs_f64());
        first.push(Span::styled(text, reversed()));
    }
    if model.held {
        first.push(Span::styled("  HELD ", reversed()));
    }
    let fault = words::fault(description, cycle);
    let style = if cycle.fault == 0 {
        Style::default()
    } else {
        reversed()
    };
    let lines = vec![
        Line::from(first),
        Line::styled(fault, style),
        Line::from(text::commander(cycle)),
    ];
    Paragraph::new(lines).wrap(Wrap { trim: true })
}

fn draw_joints(frame: &mut Frame<'_>, model: &Model, cycle: &CycleRecord, area: Rect) {
    let torque = format!("{} N·m", model.shown.name());
    let limit = "share of limit".to_owned();
    let head = [
        "joint".to_owned(),
        "q deg".to_owned(),
        torque,
        "desired".to_owned(),
        limit,
        "10 s".to_owned(),
        "least".to_owned(),
        "greatest".to_owned(),
        "remarks".to_owned(),
    ];
    let order = model.rows();
    let rows = order.iter().map(|&j| joint_row(model, cycle, j));
    let widths = [
        Constraint::Max(24),
        Constraint::Length(8),
        Constraint::Length(16),
        Constraint::Length(8),
        Constraint::Length(BAR as u16 + 6),
        Constraint::Length(PARTS as u16),
        Constraint::Length(8),
        Constraint::Length(8),
        Constraint::Fill(1),
    ];
    let table = Table::new(rows, widths)
        .header(Row::new(head).style(strong()))
        .row_highlight_style(reversed());
    let mut state = TableState::default().with_selected(Some(model.selected));
    frame.render_stateful_widget(table, area, &mut state);
}

fn joint_row(model: &Model, cycle: &CycleRecord, j: usize) -> Row<'static> {
    let kind = model.description.joint_kind(j);
    let estimated = model.shown.of(&cycle.estimated.joints[j]);
    let past = &model.pasts[j];
    let extreme = |of: fn((f64, f64)) -> f64| {
        let text = past.extremes.map(of).map(|tau| format!("{tau:8.2}"));
        text.unwrap_or_else(|| format!("{:>8}", "-"))
    };
    let share = model.share(cycle, j);
    Row::new([
        Cell::new(model.description.joint_names[j].to_string()),
        Cell::new(format!("{:8.2}", kind.shown(cycle.measured.joints[j].q))),
        Cell::new(format!("{:>16}", estimate(estimated))),
        Cell::new(format!("{:8.2}", cycle.commanded.joints[j].tau_d)),
        Cell::new(share.map_or_else(String::new, bar)),
        Cell::new(line(past)),
        Cell::new(extreme(|(low, _)| low)),
        Cell::new(extreme(|(_, high)| high)),
        Cell::new(words::remarks(&model.description, cycle, j)),
    ])
}

/// All sources of one joint side by side.
fn in_full(model: &Model, cycle: &CycleRecord) -> Paragraph<'static> {
    let rows = model.rows();
    let Some(&j) = rows.get(model.selected) else {
        return Paragraph::new(format!("no joint's name contains {:?}", model.filter));
    };
    let (measured, estimated) = (&cycle.measured.joints[j], &cycle.estimated.joints[j]);
    let commanded = &cycle.commanded.joints[j];
    let kind = model.description.joint_kind(j);
    let unit = kind.units("N·m").into_owned();
    let sources = [Shown::Hat, Shown::Encoder, Shown::WholeBody, Shown::Current]
        .map(|source| format!("{} {}", source.name(), estimate(source.of(estimated))));
    let text = vec![
        Line::from(format!("{}  {unit}", sources.join("   "))),
        Line::from(format!(
            "external {:.2}, changed by {:.2} {unit}   commanded {:.2} {unit}   current {:.2} A   dq {:.3} {}   motor {:.2} rad   age {:.1} ms",
            estimated.tau_ext,
            estimated.tau_ext_change,
            commanded.tau_star,
            measured.current,
            measured.dq,
            kind.units("rad/s"),
            measured.theta,
            1e3 * measured.age_s,
        )),
    ];
    let title = format!(" {} ", model.description.joint_names[j]);
    let block = Block::bordered().title(title);
    Paragraph::new(text).block(block)
}

fn last_events(model: &Model) -> Paragraph<'static> {
    let shown = model.events.iter().rev().take(usize::from(EVENTS));
    let mut lines: Vec<Line<'_>> = shown.map(event_line).collect();
    if lines.is_empty() {
        lines.push(Line::from("no event since this program began"));
    }
    lines.insert(0, Line::styled("events, newest first", strong()));
    Paragraph::new(lines)
}

fn event_line(occurred: &Occurred) -> Line<'static> {
    let Occurred { at_s, event, times } = occurred;
    let times = if *times > 1 {
        format!(" ({times} times)")
    } else {
        String::new()
    };
    Line::from(format!(
        "{at_s:12.3} s  {} {}{times}: {}",
        event.number(),
        event.name(),
        event.cause()
    ))
}

fn bottom(model: &Model) -> Line<'static> {
    if model.typing {
        return Line::from(format!("joints with: {}_", model.filter));
    }
    let filter = if model.filter.is_empty() {
        String::new()
    } else {
        format!("; only {:?}", model.filter)
    };
    let lost = if model.lost == 0 {
        String::new()
    } else {
        format!("; {} records came too quickly", model.lost)
    };
    Line::from(format!(
        "? keys   q end   {}, {}{filter}{lost}",
        model.shown.name(),
        model.order.name()
    ))
}

/// Value and standard deviation, or `-` for one that may not be used.
fn estimate(estimate: &TorqueEstimate) -> String {
    match valid(estimate) {
        Some(estimate) => format!("{:.2} ±{:5.2}", estimate.tau, estimate.sigma),
        None => "-".to_owned(),
    }
}

/// A share as a bar of eighths of a cell, and in per cent.
pub(super) fn bar(share: f64) -> String {
    const EIGHTHS: [char; 8] = [' ', '▏', '▎', '▍', '▌', '▋', '▊', '▉'];
    let eighths = (share.clamp(0.0, 1.0) * (8 * BAR) as f64).round() as usize;
    let mut bar = "█".repeat(eighths / 8);
    if eighths < 8 * BAR {
        bar.push(EIGHTHS[eighths % 8]);
    }
    format!("{bar:<BAR$}{:5.0}%", 100.0 * share)
}

/// The past of a torque, from its least to its greatest.
pub(super) fn line(past: &Past) -> String {
    const LEVELS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let known = past.parts.iter().flatten();
    let (low, high) = known.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(*x), high.max(*x))
    });
    let level = |x: &Option<f64>| match x {
        None => ' ',
        Some(_) if high <= low => LEVELS[0],
        Some(x) => LEVELS[((x - low) / (high - low) * 7.0).round() as usize],
    };
    past.parts.iter().map(level).collect()
}

/// The middle of an area, of this size at most.
fn centred(area: Rect, width: u16, height: u16) -> Rect {
    let (width, height) = (width.min(area.width), height.min(area.height));
    Rect {
        x: area.x + (area.width - width) / 2,
        y: area.y + (area.height - height) / 2,
        width,
        height,
    }
}

#[cfg(test)]
mod tests;
