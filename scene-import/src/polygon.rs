//! Filling polygons.

/// Adds a polygon `x0, y0, x1, y1, …` to a mask, row-major, `width * height`.
///
/// Pixels whose centre is inside are set; the first pixel's centre is at `(0.5, 0.5)`. Where the
/// outline crosses itself, an even number of crossings is outside.
pub(crate) fn fill(mask: &mut [bool], width: usize, height: usize, points: &[f64]) {
    // Where the state changes along each row; edges are only marked, so that a polygon with very
    // many of them takes no more memory than a simple one.
    let mut flips = vec![false; (width + 1) * height];
    let corners: Vec<[f64; 2]> = points.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    for (i, &[x0, y0]) in corners.iter().enumerate() {
        let [x1, y1] = corners[(i + 1) % corners.len()];
        if ![x0, y0, x1, y1].iter().all(|v| v.is_finite()) {
            continue;
        }
        // Rows whose centre lies between the ends; the upper end belongs to the edge.
        let row = |y: f64| (y - 0.5).ceil().clamp(0.0, height as f64) as usize;
        for y in row(y0.min(y1))..row(y0.max(y1)) {
            let t = (y as f64 + 0.5 - y0) / (y1 - y0);
            let x = x0 + t * (x1 - x0);
            let first = (x - 0.5).ceil().clamp(0.0, width as f64) as usize;
            flips[y * (width + 1) + first] ^= true;
        }
    }
    for y in 0..height {
        let mut inside = false;
        for x in 0..width {
            inside ^= flips[y * (width + 1) + x];
            mask[y * width + x] |= inside;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(width: usize, height: usize, polygons: &[&[f64]]) -> String {
        let mut mask = vec![false; width * height];
        for points in polygons {
            fill(&mut mask, width, height, points);
        }
        mask.chunks(width)
            .map(|row| row.iter().map(|p| if *p { '#' } else { '.' }).collect())
            .collect::<Vec<String>>()
            .join(" ")
    }

    #[test]
    fn pixels_are_set_by_their_centres() {
        // A rectangle from corner to corner of whole pixels, in either direction.
        let box_ = [1.0, 1.0, 3.0, 1.0, 3.0, 2.0, 1.0, 2.0];
        assert_eq!(drawn(4, 3, &[&box_]), ".... .##. ....");
        let back: Vec<f64> = box_.chunks(2).rev().flatten().copied().collect();
        assert_eq!(drawn(4, 3, &[&back]), ".... .##. ....");
        // Half a pixel is enough from its centre on.
        assert_eq!(
            drawn(3, 1, &[&[0.49, 0.0, 1.49, 0.0, 1.49, 1.0, 0.49, 1.0]]),
            "#.."
        );
        assert_eq!(
            drawn(3, 3, &[&[0.0, 0.0, 3.0, 0.0, 0.0, 3.0]]),
            "##. #.. ..."
        );
    }

    #[test]
    fn parts_add_up_and_nonsense_is_harmless() {
        let left = [0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0];
        let right = [2.0, 0.0, 3.0, 0.0, 3.0, 1.0, 2.0, 1.0];
        assert_eq!(drawn(3, 1, &[&left, &right, &left]), "#.#");
        // Beyond the picture on all sides.
        assert_eq!(
            drawn(2, 2, &[&[-9.0, -9.0, 99.0, -9.0, 99.0, 99.0, -9.0, 99.0]]),
            "## ##"
        );
        for odd in [
            &[][..],
            &[1.0],
            &[1.0, 1.0],
            &[0.0, 0.0, 1.0],
            &[f64::NAN; 6],
            &[1e300; 8],
        ] {
            assert_eq!(drawn(2, 1, &[odd]), "..");
        }
    }
}
