//! A report for a terminal.

use crate::finding::Report;
use std::fmt;

/// Width of the text; also in wide windows, where long lines are hard to read.
const WIDTH: usize = 100;
/// Where the sentences begin.
const INDENT: usize = 19;

impl fmt::Display for Report {
    /// One paragraph for each check, remedies marked by an arrow; then the verdict.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n", self.scene)?;
        for finding in &self.checks {
            let head = format!("  {}  {:<10}", finding.status, finding.check);
            paragraph(f, &head, &finding.says)?;
            if let Some(remedy) = &finding.remedy {
                paragraph(f, "", &format!("-> {remedy}"))?;
            }
        }
        write!(f, "\n{}", self.summary())
    }
}

fn paragraph(f: &mut fmt::Formatter<'_>, head: &str, text: &str) -> fmt::Result {
    let mut line = format!("{head:INDENT$}");
    let mut used = INDENT;
    for word in text.split(' ') {
        let length = word.chars().count();
        if used > INDENT && used + 1 + length > WIDTH {
            writeln!(f, "{}", line.trim_end())?;
            line = " ".repeat(INDENT);
            used = INDENT;
        }
        if used > INDENT {
            line.push(' ');
            used += 1;
        }
        line.push_str(word);
        used += length;
    }
    writeln!(f, "{}", line.trim_end())
}

#[cfg(test)]
mod tests {
    use crate::finding::{Finding, Report};

    #[test]
    fn lines_are_broken_at_words() {
        let long = "word ".repeat(40);
        let report = Report::new(
            "photos/cat",
            vec![Finding::pass("sharpness", long.trim()).warn("do it again")],
        );
        let text = report.to_string();
        assert!(
            text.lines().all(|line| line.chars().count() <= 100),
            "{text}"
        );
        assert!(text.contains("\n  warn  sharpness  word word"), "{text}");
        assert!(
            text.contains("\n                   -> do it again\n"),
            "{text}"
        );
        assert!(text.ends_with("after a look at it"), "{text}");
    }
}
