//! COCO's run-length masks: columns from left to right, lengths of runs that are alternately outside
//! and inside, plain or packed into text.

use crate::picture::{HALF, Matte};

/// The lengths of a matte's runs; the first is outside and may be 0.
pub(crate) fn of_matte(matte: &Matte) -> Vec<u32> {
    let (width, height) = (matte.width as usize, matte.height as usize);
    let mut lengths = Vec::new();
    let (mut inside, mut length) = (false, 0);
    for x in 0..width {
        for y in 0..height {
            if (matte.values[y * width + x] >= HALF) != inside {
                lengths.push(length);
                inside = !inside;
                length = 0;
            }
            length += 1;
        }
    }
    lengths.push(length);
    lengths
}

/// As pycocotools packs them: each number in groups of five bits from the lowest, a character (from
/// `0`) a group with its sixth bit set where another follows; the highest bit of the last group is the
/// sign. From the fourth number on, the difference to the number two before is stored.
pub(crate) fn pack(lengths: &[u32]) -> String {
    let mut text = String::new();
    for (i, length) in lengths.iter().enumerate() {
        let mut value = i64::from(*length);
        if i > 2 {
            value -= i64::from(lengths[i - 2]);
        }
        loop {
            let group = (value & 0x1f) as u8;
            value >>= 5;
            // What is left must be the sign that the group ends with, else more groups follow.
            let done = value == if group & 0x10 == 0 { 0 } else { -1 };
            text.push(char::from(48 + group + if done { 0 } else { 0x20 }));
            if done {
                break;
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matte(width: u32, height: u32, inside: impl Fn(f64, f64) -> bool) -> Matte {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Matte {
            width,
            height,
            values: pixels
                .map(|(x, y)| {
                    if inside(x.into(), y.into()) {
                        u16::MAX
                    } else {
                        0
                    }
                })
                .collect(),
        }
    }

    #[test]
    fn lengths_are_packed_as_pycocotools_does() {
        // What its encode() makes of a 9 x 10 mask with rows 2..6 of columns 3..8 set: 9 rows.
        let mask = matte(10, 9, |x, y| {
            (3.0..8.0).contains(&x) && (2.0..6.0).contains(&y)
        });
        let lengths = of_matte(&mask);
        assert_eq!(lengths, [29, 4, 5, 4, 5, 4, 5, 4, 5, 4, 21]);
        assert_eq!(pack(&lengths), "m0450000000`0");
        // Of the ellipse ((x - 30) / 20)^2 + ((y - 22) / 13)^2 < 1 in 64 x 48 pixels.
        let mask = matte(64, 48, |x, y| {
            ((x - 30.0) / 20.0).powi(2) + ((y - 22.0) / 13.0).powi(2) < 1.0
        });
        assert_eq!(
            pack(&of_matte(&mask)),
            "Ra09V12N2N2N2N2O0O2O0O2O000O2O0000000000000000000000000001N10001N101N101N2N2N2N2N_d0"
        );
    }

    #[test]
    fn runs_begin_outside_and_cover_everything() {
        assert_eq!(of_matte(&matte(3, 2, |_, _| true)), [0, 6]);
        assert_eq!(of_matte(&matte(3, 2, |_, _| false)), [6]);
        // The last two of a column and the first of the next are one run.
        assert_eq!(of_matte(&matte(2, 2, |x, y| x + y == 1.0)), [1, 2, 1]);
    }
}
