//! The word that was meant: every list of valid words answers a wrong one with the nearest.

/// Words at most this many edits away are offered when one is not known.
pub(crate) const NEAREST: usize = 3;

/// "; did you mean …?", or nothing where no known word is near.
pub(crate) fn did_you_mean<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let typed = word.to_lowercase();
    known
        .into_iter()
        .map(|known| (strsim::damerau_levenshtein(&typed, known), known))
        // As many edits as letters would turn it into any word.
        .filter(|(edits, known)| *edits <= NEAREST && *edits < known.len())
        .min_by_key(|(edits, _)| *edits)
        .map(|(_, known)| format!("; did you mean {known}?"))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_words_are_offered_and_far_ones_are_not() {
        let known = ["auto", "cpu", "cuda", "flex"];
        assert_eq!(did_you_mean("cdua", known), "; did you mean cuda?");
        assert_eq!(did_you_mean("FLEX", known), "; did you mean flex?");
        assert_eq!(did_you_mean("abacus", known), "");
    }
}
