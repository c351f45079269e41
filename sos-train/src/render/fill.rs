//! What no view saw of the background: filled in from around it.
//!
//! Pull-push (Gortler et al. 1996, "The Lumigraph", section 3.4): known colours are averaged into ever
//! smaller pictures, and what is unknown in a picture is taken from the next smaller one.

/// A colour times its weight, and the weight, in `[0, 1]`.
type Weighted = [f32; 4];

/// One size of the picture.
struct Level {
    width: usize,
    height: usize,
    values: Vec<Weighted>,
}

/// Replaces the `colours` of pixels with `known` false by what lies around them; both `[height * width]`.
///
/// Without any known pixel near them they stay as they are. Only the surroundings of what is unknown
/// are looked at, for large pictures' sake.
pub(super) fn fill(colours: &mut [[f32; 3]], known: impl Fn(usize) -> bool, width: usize) {
    let Some([x0, y0, x1, y1]) = surroundings(colours.len(), &known, width) else {
        return;
    };
    let at = |x: usize, y: usize| (y0 + y) * width + x0 + x;
    let (w, h) = (x1 - x0, y1 - y0);
    let mut values = Vec::with_capacity(w * h);
    for y in 0..h {
        for x in 0..w {
            let [r, g, b] = colours[at(x, y)];
            values.push(if known(at(x, y)) {
                [r, g, b, 1.0]
            } else {
                [0.0; 4]
            });
        }
    }
    let mut levels = vec![Level {
        width: w,
        height: h,
        values,
    }];
    while let Some(level) = levels.last().filter(|level| level.width * level.height > 1) {
        let smaller = level.pulled();
        levels.push(smaller);
    }
    while let Some(coarse) = levels.pop() {
        match levels.last_mut() {
            Some(fine) => fine.push(&coarse),
            None => {
                for (i, value) in coarse.values.into_iter().enumerate() {
                    let pixel = at(i % w, i / w);
                    if !known(pixel) && value[3] > 0.0 {
                        colours[pixel] = [value[0], value[1], value[2]].map(|c| c / value[3]);
                    }
                }
            }
        }
    }
}

/// The rectangle `[x0, y0, x1, y1]` around all pixels that are not known, with as much again on each side as
/// may count; `None` without any.
fn surroundings(pixels: usize, known: &impl Fn(usize) -> bool, width: usize) -> Option<[usize; 4]> {
    let height = pixels / width.max(1);
    let mut found: Option<[usize; 4]> = None;
    for i in (0..pixels).filter(|&i| !known(i)) {
        let (x, y) = (i % width, i / width);
        let [x0, y0, x1, y1] = found.unwrap_or([x, y, x, y]);
        found = Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)]);
    }
    found.map(|[x0, y0, x1, y1]| {
        let margin = 8 + (x1 - x0).max(y1 - y0) / 4;
        [
            x0.saturating_sub(margin),
            y0.saturating_sub(margin),
            (x1 + 1 + margin).min(width),
            (y1 + 1 + margin).min(height),
        ]
    })
}

impl Level {
    /// Half as wide and high: sums of four, with a weight of one at most.
    fn pulled(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut values = vec![[0.0; 4]; width * height];
        for (i, value) in self.values.iter().enumerate() {
            let (x, y) = (i % self.width, i / self.width);
            let sum: &mut Weighted = &mut values[y / 2 * width + x / 2];
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += value;
            }
        }
        for value in &mut values {
            let scale = 1.0 / value[3].max(1.0);
            *value = value.map(|v| v * scale);
        }
        Self {
            width,
            height,
            values,
        }
    }

    /// Fills up what has less than full weight from the next smaller picture.
    fn push(&mut self, coarse: &Self) {
        for (i, value) in self.values.iter_mut().enumerate() {
            let missing = 1.0 - value[3];
            if missing <= 0.0 {
                continue;
            }
            let (x, y) = (i % self.width, i / self.width);
            let from = coarse.between(0.5 * x as f32 - 0.25, 0.5 * y as f32 - 0.25);
            if from[3] > 0.0 {
                let scale = missing / from[3];
                for (value, from) in value.iter_mut().zip(from) {
                    *value += scale * from;
                }
            }
        }
    }

    /// Between the four nearest values; positions count from the middle of the first.
    fn between(&self, x: f32, y: f32) -> Weighted {
        let clamped = |v: f32, n: usize| v.clamp(0.0, (n - 1) as f32);
        let (x, y) = (clamped(x, self.width), clamped(y, self.height));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (tx, ty) = (x - x0 as f32, y - y0 as f32);
        let mut out = [0.0; 4];
        for (corner, weight) in [
            ((x0, y0), (1.0 - tx) * (1.0 - ty)),
            ((x1, y0), tx * (1.0 - ty)),
            ((x0, y1), (1.0 - tx) * ty),
            ((x1, y1), tx * ty),
        ] {
            let value = self.values[corner.1 * self.width + corner.0];
            for (out, value) in out.iter_mut().zip(value) {
                *out += weight * value;
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_takes_the_colour_around_it() {
        let (width, height) = (37, 23);
        let hole = |i: usize| (10..20).contains(&(i % width)) && (5..14).contains(&(i / width));
        let mut colours: Vec<[f32; 3]> = (0..width * height)
            .map(|i| if hole(i) { [9.0; 3] } else { [0.2, 0.4, 0.6] })
            .collect();
        fill(&mut colours, |i| !hole(i), width);
        for colour in colours {
            for (found, wanted) in colour.into_iter().zip([0.2, 0.4, 0.6]) {
                assert!((found - wanted).abs() < 1e-4, "{colour:?}");
            }
        }
    }

    #[test]
    fn what_is_known_stays_and_what_lies_between_lies_between() {
        let width = 64;
        let known = |i: usize| !(20..44).contains(&(i % width));
        let mut colours: Vec<[f32; 3]> = (0..width * 16)
            .map(|i| [if i % width < 32 { 0.0 } else { 1.0 }; 3])
            .collect();
        let before = colours.clone();
        fill(&mut colours, known, width);
        for (i, (now, before)) in colours.iter().zip(&before).enumerate() {
            assert!((0.0..=1.0).contains(&now[0]));
            assert!(!known(i) || now == before);
        }
        let row = &colours[8 * width..9 * width];
        assert!(row[22][0] < 0.3 && row[41][0] > 0.7);
        assert!((row[31][0] - 0.5).abs() < 0.2);
    }

    #[test]
    fn nothing_known_or_nothing_unknown_changes_nothing() {
        for known in [true, false] {
            let mut colours = vec![[0.5, 0.1, 0.2]; 12];
            fill(&mut colours, |_| known, 4);
            assert_eq!(colours, [[0.5, 0.1, 0.2]; 12]);
        }
        fill(&mut [], |_| false, 0);
    }
}
