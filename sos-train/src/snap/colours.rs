//! Whether a pixel's colour is one of the object's or of what is around it, close by.

use image::RgbImage;
use rayon::prelude::*;

/// Radius in which colours are compared, as a share of the picture's diagonal.
const WINDOW: f32 = 0.04;
/// Standard deviation of the kernel over colours, of 255.
const SPREAD: f32 = 5.0;
/// One pixel in so many, along both axes, is an example of its side.
const STRIDE: u32 = 2;
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

/// Examples in square cells as wide as the window, so that only nine are looked through.
struct Examples {
    window: f32,
    columns: usize,
    rows: usize,
    /// Where each cell's begin in `all`, and the end.
    starts: Vec<usize>,
    all: Vec<Example>,
}

/// For the pixels `asked` of a photo, some of them `inside`, log odds that their colour is the object's, less where colours close by are hard to tell
/// apart; `None` where they cannot be, and for other pixels. Examples are pixels that are `sure`.
pub(super) fn log_odds(
    photo: &RgbImage,
    inside: &[bool],
    sure: impl Fn(usize) -> bool,
    asked: &[bool],
) -> Vec<Option<f32>> {
    let examples = Examples::new(photo, inside, sure, asked);
    // How well each example is told from the other side.
    let told: Vec<f32> = examples
        .all
        .par_iter()
        .with_min_len(TASK)
        .map(|example| {
            let odds = examples.log_odds(example.x, example.y, example.colour, OWN);
            let right = if example.inside { odds } else { -odds };
            1.0 / (1.0 + (-right).exp())
        })
        .collect();
    let width = photo.width();
    asked
        .par_iter()
        .with_min_len(TASK)
        .enumerate()
        .map(|(i, asked)| {
            if !asked {
                return None;
            }
            let (x, y) = (i as u32 % width, i as u32 / width);
            let at = (x as f32, y as f32);
            let sure = examples.mean(at.0, at.1, &told);
            let belief = ((sure - POOR) / (GOOD - POOR)).clamp(0.0, 1.0);
            (belief > 0.0).then(|| belief * examples.log_odds(at.0, at.1, colour(photo, x, y), 0.0))
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
    ) -> Self {
        let (width, height) = photo.dimensions();
        let window = (WINDOW * (width as f32).hypot(height as f32)).max(1.0);
        let (columns, rows) = (
            (width as f32 / window) as usize + 1,
            (height as f32 / window) as usize + 1,
        );
        let cell_of = |x: u32, y: u32| {
            let (column, row) = cell(window, x as f32, y as f32);
            row * columns + column
        };
        // Whoever is asked looks at the cells around, and those there at the ones around them.
        let mut wanted = vec![false; columns * rows];
        for i in (0..width * height).filter(|&i| asked[i as usize]) {
            wanted[cell_of(i % width, i / width)] = true;
        }
        let wanted = grown(&wanted, columns, 2);
        let mut cells = vec![Vec::new(); columns * rows];
        for y in (0..height).step_by(STRIDE as usize) {
            for x in (0..width).step_by(STRIDE as usize) {
                let i = (y * width + x) as usize;
                let cell = cell_of(x, y);
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
        let mut starts = vec![0];
        let mut all = Vec::new();
        for examples in cells {
            all.extend(examples);
            starts.push(all.len());
        }
        Self {
            window,
            columns,
            rows,
            starts,
            all,
        }
    }

    /// Numbers and squared distances of the examples in the window around a pixel.
    fn around(&self, x: f32, y: f32) -> impl Iterator<Item = (usize, f32)> {
        let (column, row) = cell(self.window, x, y);
        let rows = row.saturating_sub(1)..(row + 2).min(self.rows);
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        // The cells of a row lie one after the other.
        let spans = rows.map(move |row| {
            self.starts[row * self.columns + columns.start]
                ..self.starts[row * self.columns + columns.end]
        });
        spans.flatten().filter_map(move |k| {
            let (dx, dy) = (self.all[k].x - x, self.all[k].y - y);
            let squared = dx * dx + dy * dy;
            (squared <= self.window * self.window).then_some((k, squared))
        })
    }

    /// Log odds that a colour at a pixel is the object's, by examples farther away than `nearest` (from 0 on, all); 0
    /// where one side has none.
    fn log_odds(&self, x: f32, y: f32, colour: [f32; 3], nearest: f32) -> f32 {
        const SCALE: f32 = -0.5 / (SPREAD * SPREAD);
        let (mut sums, mut counts) = ([0.0f32; 2], [0u32; 2]);
        for (k, squared) in self.around(x, y) {
            if nearest > 0.0 && squared <= nearest * nearest {
                continue;
            }
            let example = &self.all[k];
            let side = usize::from(example.inside);
            counts[side] += 1;
            let off = (0..3).map(|c| (example.colour[c] - colour[c]).powi(2));
            let exponent = SCALE * off.sum::<f32>();
            // Less than a hundredth of the floor, from the nearest of them.
            if exponent > -11.0 {
                sums[side] += exponent.exp();
            }
        }
        if counts.contains(&0) {
            return 0.0;
        }
        let density = |side: usize| sums[side] / counts[side] as f32 + FLOOR;
        (density(1) / density(0)).ln()
    }

    /// The mean of the examples' values in the window; 0 without any.
    fn mean(&self, x: f32, y: f32, values: &[f32]) -> f32 {
        let (mut sum, mut count) = (0.0, 0u32);
        for (k, _) in self.around(x, y) {
            sum += values[k];
            count += 1;
        }
        sum / count.max(1) as f32
    }
}

/// Cells that are `marked`, and those at most so many `steps` away, diagonally too.
fn grown(marked: &[bool], columns: usize, steps: usize) -> Vec<bool> {
    let rows = marked.len() / columns;
    let mut grown = vec![false; marked.len()];
    for i in (0..marked.len()).filter(|&i| marked[i]) {
        let (x, y) = (i % columns, i / columns);
        for y in y.saturating_sub(steps)..(y + steps + 1).min(rows) {
            let row = y * columns;
            let (first, end) = (x.saturating_sub(steps), (x + steps + 1).min(columns));
            grown[row + first..row + end].fill(true);
        }
    }
    grown
}

/// Column and row of the cell that holds a pixel.
fn cell(window: f32, x: f32, y: f32) -> (usize, usize) {
    ((x / window) as usize, (y / window) as usize)
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
        let all = log_odds(&photo, &inside, |i| i % 300 != 150, &asked);
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
