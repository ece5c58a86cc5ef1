//! Curves with no more points than a picture shows.

/// Pixels of a column in which only the extremes of a curve are drawn.
const COLUMN: f64 = 2.0;
/// Width of the square of pixels in which one dot is drawn.
const DOT: f64 = 4.0;
/// Largest distance of a point that is left out from the line drawn, pixels.
const TOLERANCE: f64 = 1.25;

/// The points that a picture shows: the extremes of each column of pixels, less those on a line
/// between others. `scale`: pixels per unit of either axis.
pub(crate) fn decimated(points: &[(f64, f64)], scale: [f64; 2]) -> Vec<(f64, f64)> {
    let column = |p: &(f64, f64)| (p.0 * scale[0] / COLUMN).floor();
    let mut kept = Vec::new();
    for points in points.chunk_by(|a, b| column(a) == column(b)) {
        let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let extremes = [
            points.iter().min_by(by_value),
            points.iter().max_by(by_value),
        ];
        let mut extremes: Vec<(f64, f64)> = extremes.into_iter().flatten().copied().collect();
        extremes.sort_by(|a, b| a.0.total_cmp(&b.0));
        extremes.dedup();
        kept.extend(extremes);
    }
    kept.extend(points.last());
    simplified(&kept, scale)
}

/// The same line from fewer points (Ramer, Douglas and Peucker).
pub(crate) fn simplified(points: &[(f64, f64)], scale: [f64; 2]) -> Vec<(f64, f64)> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return Vec::new();
    };
    let to_pixels = |p: &(f64, f64)| ((p.0 - first.0) * scale[0], (p.1 - first.1) * scale[1]);
    let (dx, dy) = to_pixels(last);
    let square = (dx * dx + dy * dy).max(f64::MIN_POSITIVE);
    let distance = |p: &(f64, f64)| {
        let (x, y) = to_pixels(p);
        let along = ((x * dx + y * dy) / square).clamp(0.0, 1.0);
        (x - along * dx).hypot(y - along * dy)
    };
    let furthest =
        (0..points.len()).max_by(|&a, &b| distance(&points[a]).total_cmp(&distance(&points[b])));
    match furthest {
        Some(i) if distance(&points[i]) > TOLERANCE => {
            let mut line = simplified(&points[..=i], scale);
            line.pop();
            line.extend(simplified(&points[i..], scale));
            line
        }
        _ => vec![*first, *last],
    }
}

/// The dots that a picture shows: one for each small square that holds any, in order.
pub(crate) fn apart(points: &[(f64, f64)], scale: [f64; 2]) -> Vec<(f64, f64)> {
    let mut pixels = std::collections::BTreeSet::new();
    let pixel = |p: &(f64, f64)| {
        (
            (p.0 * scale[0] / DOT).floor() as i64,
            (p.1 * scale[1] / DOT).floor() as i64,
        )
    };
    let new = |p: &&(f64, f64)| pixels.insert(pixel(p));
    points.iter().filter(new).copied().collect()
}

/// A curve that keeps the extremes of each of its columns while it grows.
#[derive(Debug, Clone, Default)]
pub struct Curve {
    points: Vec<(f64, f64)>,
    /// The column that grows, and its first point's place.
    column: (u64, usize),
}

impl Curve {
    /// Appends a point; points that are not finite leave no trace.
    pub fn push(&mut self, column: u64, point: (f64, f64)) {
        if !point.1.is_finite() {
            return;
        }
        if column != self.column.0 {
            self.column = (column, self.points.len());
        }
        self.points.push(point);
        let start = self.column.1;
        if let [a, b, c] = self.points[start..] {
            // The middle value is no extreme.
            let middle = match (a.1 <= b.1, b.1 <= c.1, a.1 <= c.1) {
                (true, true, _) | (false, false, _) => 1,
                (true, false, true) | (false, true, false) => 2,
                _ => 0,
            };
            self.points.remove(start + middle);
        }
    }

    /// The points, in the order of their columns.
    #[must_use]
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }
}

#[cfg(test)]
mod tests {
    use super::{Curve, decimated};

    #[test]
    fn a_curve_keeps_its_shape_and_its_spikes() {
        let mut points: Vec<(f64, f64)> = (0..10_000)
            .map(|i| (1e-3 * f64::from(i), (1e-3 * f64::from(i)).sin()))
            .collect();
        points[5_001].1 = 3.0;
        let scale = [40.0, 60.0];
        let few = decimated(&points, scale);
        assert!(few.len() < 60, "{}", few.len());
        assert!(few.contains(&points[5_001]) && few.contains(&points[9_999]));
        assert!(few.is_sorted_by(|a, b| a.0 <= b.0));
        for (t, y) in few.iter().filter(|p| p.1 < 2.0) {
            assert!((t.sin() - y).abs() < 1e-12);
        }
    }

    #[test]
    fn a_growing_curve_keeps_the_extremes_of_each_column() {
        let value = |i: u64| (i * 7919 % 101) as f64;
        let mut curve = Curve::default();
        for i in 0..1000 {
            curve.push(i / 50, (i as f64, value(i)));
            curve.push(i / 50, (i as f64, f64::NAN));
        }
        assert_eq!(curve.points().len(), 40);
        for (column, kept) in curve.points().chunks(2).enumerate() {
            let all = (0..50).map(|i| value(50 * column as u64 + i));
            assert!(kept[0].0 < kept[1].0);
            assert_eq!(kept[0].1.max(kept[1].1), all.clone().fold(0.0, f64::max));
            assert_eq!(kept[0].1.min(kept[1].1), all.fold(f64::MAX, f64::min));
        }
    }
}
