//! Pixels, or cells of a raster, row-major, and those around them.

/// Those that are `marked`, and all at most `reach` rows and columns away; `width` in a row.
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

/// The cells to the left, right, above and below of one in a raster of `len` cells; `None` beyond its end.
pub(crate) fn neighbours(
    i: usize,
    width: usize,
    len: usize,
) -> impl Iterator<Item = Option<usize>> {
    let column = i % width;
    [
        (column > 0).then(|| i - 1),
        (column + 1 < width).then_some(i + 1),
        i.checked_sub(width),
        (i + width < len).then_some(i + width),
    ]
    .into_iter()
}

/// The cells that are `marked`, as those beside them are.
pub(crate) fn well_inside(marked: &[bool], width: usize) -> Vec<bool> {
    let beside = |i| neighbours(i, width, marked.len());
    let all = |i: usize| marked[i] && beside(i).all(|j| j.is_none_or(|j| marked[j]));
    (0..marked.len()).map(all).collect()
}

/// The cells that are `marked`, but for what is less than three of them wide, or a corner.
pub(crate) fn opened(marked: &[bool], width: usize) -> Vec<bool> {
    let inside = well_inside(marked, width);
    let beside = |i| neighbours(i, width, marked.len());
    let any = |i: usize| inside[i] || beside(i).any(|j| j.is_some_and(|j| inside[j]));
    (0..marked.len()).map(any).collect()
}

/// A cell and its up to eight neighbours in a raster of `len` cells, row by row.
pub(crate) fn around(i: usize, width: usize, len: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (i % width, i / width);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    let rows = y.saturating_sub(1)..(y + 2).min(len / width);
    rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
}

/// The pieces that cells which `belong` make up where [`neighbours`] are `joined`, each from its first cell on.
pub(crate) fn pieces(
    len: usize,
    width: usize,
    belongs: impl Fn(usize) -> bool,
    joined: impl Fn(usize, usize) -> bool,
) -> Vec<Vec<usize>> {
    let mut left: Vec<bool> = (0..len).map(belongs).collect();
    let mut pieces = Vec::new();
    for first in 0..len {
        if !std::mem::take(&mut left[first]) {
            continue;
        }
        let (mut piece, mut next) = (vec![first], 0);
        while let Some(&i) = piece.get(next) {
            next += 1;
            for j in neighbours(i, width, len).flatten() {
                if left[j] && joined(i, j) {
                    left[j] = false;
                    piece.push(j);
                }
            }
        }
        pieces.push(piece);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn around_a_cell_the_raster_ends() {
        let of = |i| around(i, 4, 12).collect::<Vec<_>>();
        assert_eq!(of(0), [0, 1, 4, 5]);
        assert_eq!(of(6), [1, 2, 3, 5, 6, 7, 9, 10, 11]);
        assert_eq!(of(11), [6, 7, 10, 11]);
    }

    #[test]
    fn pieces_hang_together_by_their_sides() {
        let cells = [1, 1, 0, 2, 0, 0, 1, 2, 3, 0, 0, 2];
        let found = pieces(12, 4, |i| cells[i] > 0, |i, j| cells[i] == cells[j]);
        assert_eq!(found, [vec![0, 1], vec![3, 7, 11], vec![6], vec![8]]);
        assert!(pieces(0, 0, |_| true, |_, _| true).is_empty());
    }

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

    #[test]
    fn well_inside_is_what_has_no_other_beside_it() {
        let marked = [true, true, true, true, true, false];
        let inside = well_inside(&marked, 3);
        assert_eq!(inside, [true, true, false, true, false, false]);
    }

    #[test]
    fn opening_leaves_out_what_is_thin() {
        // A block of 3 x 3 cells, of which the corners are thin, and a line beside it.
        let block = |i: usize| (1..4).contains(&(i % 8)) && (1..4).contains(&(i / 8));
        let corner = |i: usize| i % 8 != 2 && i / 8 != 2;
        let line = |i: usize| i % 8 == 6;
        let marked: Vec<bool> = (0..40).map(|i| block(i) || line(i)).collect();
        let thick = (0..40).map(|i| block(i) && !corner(i));
        assert_eq!(opened(&marked, 8), thick.collect::<Vec<_>>());
    }
}
