//! What COLMAP's lines say about how far it is.
//!
//! Versions print the same texts differently: 3.8 as they are on standard output, 4 through a
//! logging library on standard error, which puts time and place before them. So texts are looked
//! for anywhere in a line.

/// A photo that COLMAP did not take, and why.
pub(crate) type Damaged = (String, String);

/// Reads the lines of one command.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    name: String,
    most_poses: usize,
    /// Photos that were refused.
    pub(crate) damaged: Vec<Damaged>,
}

impl Lines {
    /// Photos done and in all, after a line of `feature_extractor`.
    pub(crate) fn features(&mut self, line: &str) -> Option<(usize, usize)> {
        if let Some((_, name)) = line.split_once("  Name:") {
            self.name = name.trim().to_owned();
        } else if let Some((_, why)) = line.split_once("  ERROR: ") {
            self.damaged
                .push((self.name.clone(), why.trim().to_owned()));
        } else if let Some((_, why)) = line.split_once("_ERROR: ") {
            // The name is in the line too, with time and place before it.
            self.damaged
                .push((self.name.clone(), why.trim().to_owned()));
        }
        fraction(after(line, "Processed file [")?)
    }

    /// Parts done and in all, after a line of any matcher.
    pub(crate) fn matches(&mut self, line: &str) -> Option<(usize, usize)> {
        let verbs = ["Matching ", "Processing "];
        let inside = verbs.iter().find_map(|verb| {
            after(line, &format!("{verb}block ["))
                .or_else(|| after(line, &format!("{verb}image [")))
        })?;
        match inside.split_once(", ") {
            // Row and column of a block of pairs.
            Some((row, column)) => {
                let (i, rows) = fraction(row)?;
                let (j, columns) = fraction(column)?;
                let done = i.checked_sub(1)?.checked_mul(columns)?.checked_add(j)?;
                Some((done, rows.checked_mul(columns)?))
            }
            None => fraction(inside),
        }
    }

    /// Photos with poses, after a line of `mapper`: `Registering image #9 (26)` or
    /// `Registering image #9 (num_reg_frames=26)`. Never fewer than before: a second model starts
    /// from none.
    pub(crate) fn poses(&mut self, line: &str) -> Option<usize> {
        let (_, rest) = line.split_once("Registering image #")?;
        let inside = rest.split_once('(')?.1.split_once(')')?.0;
        let digits = inside.rsplit('=').next()?;
        self.most_poses = self.most_poses.max(digits.trim().parse().ok()?);
        Some(self.most_poses)
    }
}

/// What is between the text and the next bracket.
fn after<'a>(line: &'a str, text: &str) -> Option<&'a str> {
    Some(line.split_once(text)?.1.split_once(']')?.0)
}

/// `3/30`.
fn fraction(text: &str) -> Option<(usize, usize)> {
    let (done, total) = text.split_once('/')?;
    let (done, total) = (done.trim().parse().ok()?, total.trim().parse().ok()?);
    (done <= total).then_some((done, total))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PREFIX: &str = "I20260808 20:28:58.123456 12345 feature_matching.cc:271] ";

    #[test]
    fn features_are_counted() {
        let mut lines = Lines::default();
        assert_eq!(lines.features("Processed file [3/30]"), Some((3, 30)));
        let four = format!("{PREFIX}Processed file [30/30]");
        assert_eq!(lines.features(&four), Some((30, 30)));
        for line in [
            "",
            "Processed file [",
            "Processed file [x/3]",
            "Processed file [4/3]",
        ] {
            assert_eq!(lines.features(line), None, "{line}");
        }
        assert!(lines.damaged.is_empty());
    }

    #[test]
    fn photos_that_are_refused_are_named() {
        let mut lines = Lines::default();
        for line in [
            "  Name:            a b.jpg",
            "  ERROR: Failed to read image file format.",
            "I1 x.cc:1]   Name:            c.jpg",
            "W1 x.cc:2] c.jpg BITMAP_ERROR: Failed to read the image file format.",
        ] {
            assert_eq!(lines.features(line), None);
        }
        let why = [
            "Failed to read image file format.",
            "Failed to read the image file format.",
        ];
        let expected = [("a b.jpg", why[0]), ("c.jpg", why[1])]
            .map(|(name, why)| (name.to_owned(), why.to_owned()));
        assert_eq!(lines.damaged, expected);
    }

    #[test]
    fn matches_are_counted_in_blocks_and_images() {
        let mut lines = Lines::default();
        for (line, expected) in [
            ("Matching block [1/1, 1/1] in 19.184s", Some((1, 1))),
            ("Matching block [2/3, 1/3] in 0.1s", Some((4, 9))),
            ("Processing block [3/3, 3/3]", Some((9, 9))),
            ("Matching image [5/30] in 0.049s", Some((5, 30))),
            ("Processing image [5/30]", Some((5, 30))),
            ("Matching block [0/3, 1/3]", None),
            (
                "Matching block [1/18446744073709551615, 1/18446744073709551615]",
                None,
            ),
            ("Exhaustive feature matching", None),
        ] {
            assert_eq!(lines.matches(line), expected, "{line}");
            assert_eq!(
                lines.matches(&format!("{PREFIX}{line}")),
                expected,
                "{line}"
            );
        }
    }

    #[test]
    fn poses_are_counted_and_never_fewer() {
        let mut lines = Lines::default();
        assert_eq!(lines.poses("Registering image #9 (26)"), Some(26));
        assert_eq!(
            lines.poses("Registering image #2 (num_reg_frames=27)"),
            Some(27)
        );
        assert_eq!(lines.poses("Registering image #3 (3)"), Some(27));
        assert_eq!(lines.poses("Registering image #3"), None);
        assert_eq!(lines.poses("Global bundle adjustment"), None);
    }
}
