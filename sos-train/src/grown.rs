//! Pixels, or cells, and those around them.

/// Those that are `marked`, and all at most `reach` rows and columns away; row-major, `width` in a row.
pub(crate) fn grown(marked: &[bool], width: usize, reach: usize) -> Vec<bool> {
    let height = marked.len() / width.max(1);
    let mut grown = vec![false; marked.len()];
    for i in (0..marked.len()).filter(|&i| marked[i]) {
        let (x, y) = (i % width, i / width);
        let (first, end) = (x.saturating_sub(reach), (x + reach + 1).min(width));
        for y in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            grown[y * width + first..y * width + end].fill(true);
        }
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_marked_grows_to_a_square_within_the_picture() {
        let mut marked = vec![false; 7 * 5];
        marked[7 + 6] = true;
        let found = grown(&marked, 7, 2);
        for (i, found) in found.into_iter().enumerate() {
            assert_eq!(found, i % 7 >= 4 && i / 7 <= 3, "{i}");
        }
        assert!(grown(&[], 0, 1).is_empty());
    }
}
