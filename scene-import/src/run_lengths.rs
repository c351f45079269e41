//! COCO's run-length masks: columns from left to right, lengths of runs that are alternately outside
//! and inside, plain or packed into text.

/// The lengths in packed text.
///
/// Each number is in groups of five bits from the lowest, a character (from `0`) a group with its
/// sixth bit set where another follows; the highest bit of the last group is the sign. From the
/// fourth number on, the difference to the number two before is stored.
pub(crate) fn unpack(text: &str) -> Result<Vec<u32>, String> {
    let mut lengths: Vec<i64> = Vec::new();
    let mut bytes = text.bytes();
    while let Some(first) = bytes.next() {
        let (mut value, mut shift, mut byte) = (0_i64, 0, first);
        loop {
            let group = byte
                .checked_sub(48)
                .filter(|group| *group < 64 && shift <= 40)
                .ok_or("its packed run lengths are damaged")?;
            value |= i64::from(group & 0x1f) << shift;
            shift += 5;
            if group & 0x20 == 0 {
                if group & 0x10 != 0 {
                    value |= -1 << shift;
                }
                break;
            }
            byte = bytes.next().ok_or("its packed run lengths are cut off")?;
        }
        if lengths.len() > 2 {
            value += lengths[lengths.len() - 2];
        }
        lengths.push(value);
    }
    lengths
        .into_iter()
        .map(|length| u32::try_from(length).map_err(|_| "a run length is negative".to_owned()))
        .collect()
}

/// Adds the runs to a mask, row-major, `width * height`.
pub(crate) fn fill(
    mask: &mut [bool],
    width: usize,
    height: usize,
    lengths: &[u32],
) -> Result<(), String> {
    let total: u64 = lengths.iter().map(|length| u64::from(*length)).sum();
    if total != (width * height) as u64 {
        return Err(format!(
            "its run lengths cover {total} pixels of {width}x{height}"
        ));
    }
    let mut at = 0;
    for (i, &length) in lengths.iter().enumerate() {
        let end = at + length as usize;
        if i % 2 == 1 {
            for pixel in at..end {
                mask[pixel % height * width + pixel / height] = true;
            }
        }
        at = end;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn packed_lengths_are_those_of_pycocotools() {
        // What its encode() makes of a 9 x 10 mask with rows 2..6 of columns 3..8 set.
        let lengths = unpack("m0450000000`0").unwrap();
        assert_eq!(lengths, [29, 4, 5, 4, 5, 4, 5, 4, 5, 4, 21]);
        // Of the ellipse ((x - 30) / 20)^2 + ((y - 22) / 13)^2 < 1 in 64 x 48 pixels.
        let lengths = unpack(
            "Ra09V12N2N2N2N2O0O2O0O2O000O2O0000000000000000000000000001N10001N101N101N2N2N2N2N_d0",
        )
        .unwrap();
        let mut mask = vec![false; 64 * 48];
        fill(&mut mask, 64, 48, &lengths).unwrap();
        for (i, inside) in mask.iter().enumerate() {
            let (x, y) = ((i % 64) as f64, (i / 64) as f64);
            let ellipse = ((x - 30.0) / 20.0).powi(2) + ((y - 22.0) / 13.0).powi(2) < 1.0;
            assert_eq!(*inside, ellipse, "{x} {y}");
        }
        assert_eq!(unpack("").unwrap(), Vec::<u32>::new());
        for damaged in ["P", "\u{7f}", " ", "oooooooooooooooo0", "ü", "00O"] {
            assert!(unpack(damaged).is_err(), "{damaged:?}");
        }
    }

    #[test]
    fn runs_go_down_the_columns() {
        let mut mask = vec![false; 6];
        // Columns of two: outside, then three inside, then two outside.
        fill(&mut mask, 3, 2, &[1, 3, 2]).unwrap();
        assert_eq!(mask, [false, true, false, true, true, false]);
        assert!(
            fill(&mut mask, 3, 2, &[1, 3, 1])
                .unwrap_err()
                .contains("5 pixels")
        );
        assert!(fill(&mut mask, 3, 2, &[u32::MAX, u32::MAX]).is_err());
    }
}
