//! `[recorder]`.

use crate::parameters::RecorderSettings;
use crate::reader::{Allowed, Section};
use robot_state::Content;

const MB: f64 = 1e6;
const GB: f64 = 1e9;
const HOUR_S: f64 = 3600.0;

/// The recording that always runs, if there is the table.
pub(crate) fn recorder(root: &Section<'_, '_>, sample_period: f64) -> Option<RecorderSettings> {
    let section = root.optional_section("recorder")?;
    let choices = Content::ALL.map(|content| (content.name(), content));
    let content = section.choice_or("content", Content::Frames, &choices);
    // While the loop's rate is unknown, the highest one counts.
    let loop_hz = if sample_period.is_nan() {
        10_000.0
    } else {
        1.0 / sample_period
    };
    let rate_hz = section.optional_number("rate_Hz", Allowed::Within(0.1, loop_hz));
    if rate_hz.is_some() && content != Content::Torques {
        let reason = format!("rate_Hz with content = {:?}", content.name());
        section.problem("rate_Hz", reason, "only with content = \"torques\"");
    }
    let file = section.number_or("file_MB", 250.0, Allowed::Within(1.0, 100_000.0));
    let file = file.max(1.0); // NaN where a problem was noted
    // Two files: one that is written, and one that is kept.
    let kept = Allowed::Within(2.0 * file * MB / GB, 1e6);
    let kept_gb = section.number_or("keep_GB", 20.0_f64.max(2.0 * file * MB / GB), kept);
    let kept_h = section.number_or("keep_h", 168.0, Allowed::Within(0.01, 1e6));
    section.finish();
    Some(RecorderSettings {
        content,
        rate_hz,
        file_bytes: (file * MB) as u64,
        kept_bytes: (kept_gb * GB) as u64,
        kept_s: kept_h * HOUR_S,
    })
}
