//! Whether a pixel's colour is one of the object's or of what is around it, close by.

use image::RgbImage;
use rayon::prelude::*;

use crate::cells::grown;

/// Side of a square cell, in bands: a pixel's colour is compared with those in its own cell and the eight around it.
pub(super) const CELL: f32 = 2.4;
/// Standard deviation of the kernel over colours, of 255.
const SPREAD: f32 = 5.0;
/// One pixel in so many, along both axes, is an example of its side.
const STRIDE: u32 = 2;
/// One example in so many is asked how well it is told from the other side.
const CHECKED: usize = 3;
/// Pixels that one task looks at.
const TASK: usize = 256;
/// Density of colours that are like none.
const FLOOR: f32 = 1e-3;
/// How well examples are told apart by the others around them, on average: from where on colours say anything, and
/// where they are believed in full.
const POOR: f32 = 0.7;
const GOOD: f32 = 0.95;
/// Examples at least as near as this do not count for one of them: they are parts of the same blur.
const OWN: f32 = 2.0;

/// A pixel whose side is known.
#[derive(Clone, Copy, Debug)]
struct Example {
    x: f32,
    y: f32,
    colour: [f32; 3],
    inside: bool,
}

/// Examples in square cells.
struct Examples {
    side: f32,
    columns: usize,
    rows: usize,
    /// Where each cell's begin in `all`, row by row, and the end.
    starts: Vec<usize>,
    all: Vec<Example>,
}

/// For the pixels `asked` of a photo, some of them `inside`, log odds that their colour is the object's, less where colours
/// close by are hard to tell apart; `None` where they cannot be, and for other pixels. Examples are pixels that are `sure`;
/// `band` is as in [`snap`](super::snap).
pub(super) fn log_odds(
    photo: &RgbImage,
    inside: &[bool],
    sure: impl Fn(usize) -> bool,
    asked: &[bool],
    band: f32,
) -> Vec<Option<f32>> {
    let examples = Examples::new(photo, inside, sure, asked, band);
    let beliefs = examples.beliefs();
    let width = photo.width();
    asked
        .par_iter()
        .with_min_len(TASK)
        .enumerate()
        .map(|(i, asked)| {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let belief = asked.then(|| beliefs[examples.cell(x, y)])?;
            (belief > 0.0).then(|| belief * examples.log_odds(x, y, colour(photo, x, y), None))
        })
        .collect()
}

fn colour(photo: &RgbImage, x: u32, y: u32) -> [f32; 3] {
    photo.get_pixel(x, y).0.map(f32::from)
}

impl Examples {
    fn new(
        photo: &RgbImage,
        inside: &[bool],
        sure: impl Fn(usize) -> bool,
        asked: &[bool],
        band: f32,
    ) -> Self {
        let (width, height) = photo.dimensions();
        let side = (CELL * band).max(1.0);
        let count = |pixels: u32| (pixels as f32 / side) as usize + 1;
        let mut examples = Self {
            side,
            columns: count(width),
            rows: count(height),
            starts: vec![0],
            all: Vec::new(),
        };
        // Whoever is asked looks at the cells around, and those there at the ones around them.
        let mut wanted = vec![false; examples.columns * examples.rows];
        for i in (0..width * height).filter(|&i| asked[i as usize]) {
            wanted[examples.cell(i % width, i / width)] = true;
        }
        let wanted = grown(&wanted, examples.columns, 2);
        let mut cells = vec![Vec::new(); wanted.len()];
        for y in (0..height).step_by(STRIDE as usize) {
            for x in (0..width).step_by(STRIDE as usize) {
                let i = (y * width + x) as usize;
                let cell = examples.cell(x, y);
                if wanted[cell] && sure(i) {
                    cells[cell].push(Example {
                        x: x as f32,
                        y: y as f32,
                        colour: colour(photo, x, y),
                        inside: inside[i],
                    });
                }
            }
        }
        for cell in cells {
            examples.all.extend(cell);
            examples.starts.push(examples.all.len());
        }
        examples
    }

    /// The cell that holds a pixel.
    fn cell(&self, x: u32, y: u32) -> usize {
        let along = |pixel: u32| (pixel as f32 / self.side) as usize;
        along(y) * self.columns + along(x)
    }

    /// First and end cells of up to three rows around a cell.
    fn around(&self, cell: usize) -> impl Iterator<Item = (usize, usize)> {
        let (column, row) = (cell % self.columns, cell / self.columns);
        let (first, end) = (column.saturating_sub(1), (column + 2).min(self.columns));
        let columns = self.columns;
        (row.saturating_sub(1)..(row + 2).min(self.rows))
            .map(move |row| (row * columns + first, row * columns + end))
    }

    /// For each cell, how far colours in it and around it are believed: by how well examples there are told from the
    /// other side.
    fn beliefs(&self) -> Vec<f32> {
        let cells = self.columns * self.rows;
        let told: Vec<(f32, u32)> = (0..cells)
            .into_par_iter()
            .map(|cell| {
                let own = &self.all[self.starts[cell]..self.starts[cell + 1]];
                let shares = own.iter().step_by(CHECKED).map(|example| {
                    let (x, y) = (example.x, example.y);
                    let odds = self.log_odds(x as u32, y as u32, example.colour, Some((x, y)));
                    let right = if example.inside { odds } else { -odds };
                    1.0 / (1.0 + (-right).exp())
                });
                shares.fold((0.0, 0), |(sum, count), share| (sum + share, count + 1))
            })
            .collect();
        let belief = |cell: usize| {
            let spans = self.around(cell).map(|(first, end)| &told[first..end]);
            let (sum, count) = spans
                .flatten()
                .fold((0.0, 0), |all, own| (all.0 + own.0, all.1 + own.1));
            let sure = sum / count.max(1) as f32;
            ((sure - POOR) / (GOOD - POOR)).clamp(0.0, 1.0)
        };
        (0..cells).map(belief).collect()
    }

    /// Log odds that a colour at a pixel is the object's, by the examples in its cell and around it, but for those at an
    /// example's own place; 0 where one side has none.
    fn log_odds(&self, x: u32, y: u32, colour: [f32; 3], own: Option<(f32, f32)>) -> f32 {
        const SCALE: f32 = -0.5 / (SPREAD * SPREAD);
        let (mut sums, mut counts) = ([0.0f32; 2], [0u32; 2]);
        for (first, end) in self.around(self.cell(x, y)) {
            for example in &self.all[self.starts[first]..self.starts[end]] {
                if own.is_some_and(|(x, y)| {
                    (example.x - x).powi(2) + (example.y - y).powi(2) <= OWN * OWN
                }) {
                    continue;
                }
                let side = usize::from(example.inside);
                counts[side] += 1;
                let off = (0..3).map(|c| (example.colour[c] - colour[c]).powi(2));
                let exponent = SCALE * off.sum::<f32>();
                // Less than a fiftieth of the floor.
                if exponent > -11.0 {
                    sums[side] += exponent.exp();
                }
            }
        }
        if counts.contains(&0) {
            return 0.0;
        }
        let density = |side: usize| sums[side] / counts[side] as f32 + FLOOR;
        (density(1) / density(0)).ln()
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// Left half inside.
    fn odds(left: [u8; 3], right: [u8; 3], odd: [u8; 3]) -> Option<f32> {
        let photo = RgbImage::from_fn(300, 200, |x, _| {
            Rgb(match x {
                150 => odd,
                x if x < 150 => left,
                _ => right,
            })
        });
        let inside: Vec<bool> = (0..300 * 200).map(|i| i % 300 < 150).collect();
        let mut asked = vec![false; 300 * 200];
        asked[100 * 300 + 150] = true;
        let all = log_odds(&photo, &inside, |i| i % 300 != 150, &asked, 4.0);
        assert!(
            all.iter()
                .zip(&asked)
                .all(|(odds, asked)| *asked || odds.is_none())
        );
        all[100 * 300 + 150]
    }

    #[test]
    fn a_colour_is_of_the_side_that_has_it() {
        let (red, blue) = ([200, 40, 30], [30, 60, 190]);
        assert!(odds(red, blue, red) > Some(3.0));
        assert!(odds(red, blue, blue).is_some_and(|odds| odds < -3.0));
        assert!(odds(red, blue, [90, 250, 90]).is_some_and(|odds| odds.abs() < 1e-3));
    }

    #[test]
    fn where_both_sides_are_alike_nothing_is_said() {
        let grey = [120; 3];
        assert_eq!(odds(grey, grey, grey), None);
        assert_eq!(odds(grey, [123; 3], grey), None);
    }
}
