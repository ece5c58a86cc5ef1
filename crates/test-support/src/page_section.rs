//! Parts of a page of results that another program writes than the page itself.

/// The part of a page from its heading, a line, to the next one of the same level; empty if there is none.
#[must_use]
pub fn section<'a>(page: &'a str, heading: &str) -> &'a str {
    let line = format!("\n{heading}\n");
    let Some(from) = page.find(&line) else {
        return "";
    };
    let after = from + line.len();
    let end = page[after..].find("\n## ").map(|at| after + at);
    &page[from..end.unwrap_or(page.len())]
}

/// The page with this part instead of its own, or before `next` if it has none, or at its end. The part begins with an
/// empty line, and its heading.
#[must_use]
pub fn with_section(page: &str, heading: &str, part: &str, next: &str) -> String {
    let own = section(page, heading);
    if !own.is_empty() {
        return page.replacen(own, part, 1);
    }
    let at = page.find(next).unwrap_or(page.len());
    format!("{}{part}{}", &page[..at], &page[at..])
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "# T\n\nText.\n\n## A\n\none\n\n## B\n\ntwo\n";

    #[test]
    fn a_part_is_found_replaced_and_put_in() {
        assert_eq!(section(PAGE, "## A"), "\n## A\n\none\n");
        assert_eq!(section(PAGE, "## B"), "\n## B\n\ntwo\n");
        assert_eq!(section(PAGE, "## C"), "");
        let new = "\n## A\n\nthree\n";
        let page = with_section(PAGE, "## A", new, "\n## B\n");
        assert_eq!(page, "# T\n\nText.\n\n## A\n\nthree\n\n## B\n\ntwo\n");
        let without = PAGE.replace(section(PAGE, "## A"), "");
        assert_eq!(with_section(&without, "## A", new, "\n## B\n"), page);
    }
}
