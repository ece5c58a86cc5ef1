//! Pages of results: their long tables become CSV files beside the page, which keeps the rows that count.

use std::fmt::Write as _;
use std::path::Path;

const BEGIN: &str = "<!-- rows: ";
const END: &str = " -->";

/// A page as it is read, and the files of its rows: name and text.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ResultsPage {
    /// The page.
    pub text: String,
    /// Names and texts of the CSV files.
    pub files: Vec<(String, String)>,
}

/// The rows of a table that stay in the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kept<'a> {
    None,
    First(usize),
    Greatest(usize, &'a str),
    Least(usize, &'a str),
}

impl<'a> Kept<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        if text.is_empty() {
            return Some(Self::None);
        }
        if let Some(count) = text.strip_prefix("first ") {
            return Some(Self::First(count.parse().ok()?));
        }
        let (count, rest) = text.split_once(' ')?;
        let count = count.parse().ok()?;
        match rest.split_once(" of ")? {
            ("greatest", column) => Some(Self::Greatest(count, column)),
            ("least", column) => Some(Self::Least(count, column)),
            _ => None,
        }
    }
}

impl ResultsPage {
    /// The page of a text with marked tables. A mark is a line of its own before the empty line or head of a table:
    /// `<!-- rows: NAME.csv -->` moves all rows into that file, `<!-- rows: NAME.csv, first 4 -->` keeps four of them
    /// in the page too, `<!-- rows: NAME.csv, 5 greatest of COLUMN -->` (or `least`) the five with the greatest size
    /// of the first number in that column, and states its median. Rows that begin in italics sum up the others: they stay
    /// and are not counted. A table without a mark stays.
    ///
    /// # Errors
    /// A mark that does not lead to a table, or names no column of it.
    pub fn new(marked: &str) -> Result<Self, String> {
        let mut page = Self::default();
        let mut rest = marked;
        while let Some((before, after)) = rest.split_once(BEGIN) {
            page.text += before;
            let (mark, after) = after.split_once(END).ok_or("a mark without end")?;
            let after = after.trim_start_matches('\n');
            let until = after.find("\n\n").map_or(after.len(), |at| at + 1);
            page.table(mark, &after[..until])?;
            rest = &after[until..];
        }
        page.text += rest;
        Ok(page)
    }

    /// Writes the page, and the files beside it.
    ///
    /// # Errors
    /// The path that could not be written, and why.
    #[allow(clippy::disallowed_methods)] // a bench's result, as tests' files
    pub fn write(&self, path: &Path) -> Result<(), String> {
        let own = [(path.to_path_buf(), &self.text)];
        let files = self.files.iter();
        let beside = files.map(|(name, text)| (path.with_file_name(name), text));
        for (path, text) in own.into_iter().chain(beside) {
            std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
        }
        Ok(())
    }

    fn table(&mut self, mark: &str, table: &str) -> Result<(), String> {
        let (name, kept) = mark.split_once(", ").unwrap_or((mark, ""));
        let kept = Kept::parse(kept).ok_or_else(|| format!("a mark that is none: {mark}"))?;
        let lines: Vec<&str> = table.lines().collect();
        let [head, rule, rows @ ..] = lines.as_slice() else {
            return Err(format!("{mark}: no table behind it"));
        };
        if !rule.starts_with("| --") {
            return Err(format!("{mark}: no table behind it"));
        }
        let mut file = String::new();
        for line in [head].into_iter().chain(rows) {
            let cells: Vec<String> = cells(line).map(csv_cell).collect();
            let _ = writeln!(file, "{}", cells.join(","));
        }
        self.files.push((name.to_owned(), file));
        let (remark, rows) = choose(name, kept, head, rows)?;
        self.text += &remark;
        if !rows.is_empty() {
            let _ = writeln!(self.text, "\n{head}\n{rule}\n{}", rows.join("\n"));
        }
        Ok(())
    }
}

/// What the page says of the rows, and those that it shows.
fn choose<'a>(
    name: &str,
    kept: Kept<'_>,
    head: &str,
    rows: &[&'a str],
) -> Result<(String, Vec<&'a str>), String> {
    let (sums, rows): (Vec<&str>, Vec<&str>) = rows.iter().partition(|row| row.starts_with("| *"));
    let all = rows.len();
    let (count, of, sign) = match kept {
        Kept::None => return Ok((format!("[All {all} rows]({name}).\n"), Vec::new())),
        Kept::First(count) => {
            let count = count.min(all);
            let first = if count == 1 {
                "First".to_owned()
            } else {
                format!("First {count}")
            };
            let remark = format!("{first} of {all} rows, [all]({name}):\n");
            return Ok((remark, rows.into_iter().take(count).chain(sums).collect()));
        }
        Kept::Greatest(count, column) => (count.min(all), column, -1.0),
        Kept::Least(count, column) => (count.min(all), column, 1.0),
    };
    let column = cells(head).position(|cell| cell == of);
    let column = column.ok_or_else(|| format!("{name}: no column {of}"))?;
    let size = |row: &str| cells(row).nth(column).and_then(number).map(f64::abs);
    let mut sorted: Vec<(f64, &str)> = rows.iter().filter_map(|r| Some((size(r)?, *r))).collect();
    sorted.sort_by(|a, b| (sign * a.0).total_cmp(&(sign * b.0)));
    let median = sorted.get(sorted.len() / 2).map(|(_, row)| *row);
    let median = median.and_then(|row| cells(row).nth(column)).unwrap_or("-");
    let median = median.split(" (").next().unwrap_or(median);
    let most = if sign < 0.0 { "Greatest" } else { "Least" };
    let remark = format!("{most} \"{of}\" of {all} rows (median {median}), [all]({name}):\n");
    Ok((
        remark,
        (sorted.into_iter().take(count))
            .map(|(_, row)| row)
            .chain(sums)
            .collect(),
    ))
}

fn cells(line: &str) -> impl Iterator<Item = &str> {
    let line = line.trim().trim_start_matches('|').trim_end_matches('|');
    line.split(" |").map(str::trim)
}

/// The first number of a cell.
fn number(cell: &str) -> Option<f64> {
    let from = cell.find(|c: char| c.is_ascii_digit())?;
    let digits = &cell[from..];
    let until = digits.find(|c: char| !c.is_ascii_digit() && c != '.');
    digits[..until.unwrap_or(digits.len())].parse().ok()
}

fn csv_cell(cell: &str) -> String {
    let plain = cell.replace("**", "");
    if plain.contains([',', '"']) {
        format!("\"{}\"", plain.replace('"', "\"\""))
    } else {
        plain
    }
}

#[cfg(test)]
mod tests {
    use super::ResultsPage;

    fn page(mark: &str) -> ResultsPage {
        let table = "| robot | ratio |\n| --- | --- |\n| a, b | -0.5 (x) |\n| c | 0.7 |\n| d | - |\n| e | 0.6 |\n";
        ResultsPage::new(&format!(
            "# T\n\n<!-- rows: r.csv{mark} -->\n\n{table}\nEnd.\n"
        ))
        .expect("a page")
    }

    #[test]
    fn all_rows_are_in_the_file_and_those_that_count_in_the_page() {
        let it = page(", 2 greatest of ratio");
        assert_eq!(
            it.text,
            "# T\n\nGreatest \"ratio\" of 4 rows (median 0.6), [all](r.csv):\n\n\
             | robot | ratio |\n| --- | --- |\n| c | 0.7 |\n| e | 0.6 |\n\nEnd.\n"
        );
        let file = "robot,ratio\n\"a, b\",-0.5 (x)\nc,0.7\nd,-\ne,0.6\n";
        assert_eq!(it.files, [("r.csv".to_owned(), file.to_owned())]);
        assert!(
            page(", 1 least of ratio")
                .text
                .contains("| a, b | -0.5 (x) |")
        );
        assert!(page(", first 1").text.contains("First of 4 rows, [all]"));
        let summed = "<!-- rows: r.csv, 1 least of b -->\n\n| a | b |\n| --- | --- |\n| x | 3 |\n| *y* | *1* |\n";
        let summed = ResultsPage::new(summed).expect("a page").text;
        assert!(summed.ends_with("of 1 rows (median 3), [all](r.csv):\n\n| a | b |\n| --- | --- |\n| x | 3 |\n| *y* | *1* |\n"));
        assert_eq!(page("").text, "# T\n\n[All 4 rows](r.csv).\n\nEnd.\n");
    }

    #[test]
    fn a_mark_that_is_wrong_is_refused() {
        for wrong in [
            "<!-- rows: r.csv",
            "<!-- rows: r.csv -->\n\nText.\n",
            "<!-- rows: r.csv, 2 of x -->\n\n",
        ] {
            assert!(ResultsPage::new(wrong).is_err(), "{wrong}");
        }
        let table = "<!-- rows: r.csv, 2 least of b -->\n\n| a |\n| --- |\n| 1 |\n";
        assert!(ResultsPage::new(table).is_err());
    }
}
