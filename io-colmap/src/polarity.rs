//! Which colour of a mask means the object.

use crate::error::ColmapError;
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::Path;

/// The colour that marks the object in mask files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Polarity {
    /// NeuS, most segmentation networks, SPIn-NeRF, instant-ngp's `dynamic_mask`.
    WhiteIsObject,
    /// Masks made to hide the object from a reconstruction (COLMAP, nerfstudio: black is ignored).
    BlackIsObject,
}

impl std::fmt::Display for Polarity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Polarity::WhiteIsObject => "white = object",
            Polarity::BlackIsObject => "black = object",
        })
    }
}

/// Beside masks, says which colour is the object in them: `white = object` or `black = object`.
pub const POLARITY_FILE: &str = "polarity.txt";

impl Polarity {
    /// What the [`POLARITY_FILE`] in a folder of masks says, if there is one.
    ///
    /// # Errors
    /// [`ColmapError`] if it cannot be read, or says neither.
    pub(crate) fn stated_in(folder: &Path) -> Result<Option<Self>, ColmapError> {
        let path = folder.join(POLARITY_FILE);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            // The folder may be a file that lists masks.
            Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Ok(None);
            }
            Err(e) => return Err(ColmapError::io("read", &path, e)),
        };
        let all = [Self::WhiteIsObject, Self::BlackIsObject];
        match all.into_iter().find(|it| it.to_string() == text.trim()) {
            Some(polarity) => Ok(Some(polarity)),
            None => Err(ColmapError::mask(
                &path,
                "it says nothing about masks that is known",
                "write \"white = object\" or \"black = object\" into it, or remove it",
            )),
        }
    }
}

/// Fractions of white in one mask.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Share {
    /// Within a band of a sixteenth of the shorter side along the border.
    pub(crate) border: f64,
    /// Within the middle half of both axes.
    pub(crate) centre: f64,
    /// Everywhere.
    pub(crate) all: f64,
}

/// Measured on a grid of at most this many samples a side: fractions need no more.
const GRID: u32 = 256;

impl Share {
    /// Of a mask of that size, whose bytes by pixel are given.
    pub(crate) fn of((w, h): (u32, u32), byte: impl Fn(u32, u32) -> u8) -> Share {
        let (nx, ny) = (w.clamp(1, GRID), h.clamp(1, GRID));
        let band = f64::from(nx.min(ny)) / 16.0;
        let mut sums = [(0.0, 0.0); 3];
        if w == 0 || h == 0 {
            return Share {
                border: 0.0,
                centre: 0.0,
                all: 0.0,
            };
        }
        for j in 0..ny {
            for i in 0..nx {
                // Samples at the centres of the grid's cells.
                let x = ((f64::from(i) + 0.5) / f64::from(nx) * f64::from(w)) as u32;
                let y = ((f64::from(j) + 0.5) / f64::from(ny) * f64::from(h)) as u32;
                let white = f64::from(byte(x.min(w - 1), y.min(h - 1))) / 255.0;
                let edge = f64::from(i.min(nx - 1 - i).min(j).min(ny - 1 - j));
                let middle =
                    (nx / 4..nx - nx / 4).contains(&i) && (ny / 4..ny - ny / 4).contains(&j);
                for (sum, belongs) in sums.iter_mut().zip([edge < band.max(1.0), middle, true]) {
                    if belongs {
                        *sum = (sum.0 + white, sum.1 + 1.0);
                    }
                }
            }
        }
        let [border, centre, all] = sums.map(|(sum, n): (f64, f64)| sum / n.max(1.0));
        Share {
            border,
            centre,
            all,
        }
    }

    /// Whether the mask is of one colour and so says nothing about polarity.
    pub(crate) fn is_plain(&self) -> bool {
        self.all < 1e-4 || self.all > 1.0 - 1e-4
    }
}

/// The joint decision and the sentence that gives its reasons in numbers.
pub(crate) fn decide(shares: &[Share]) -> (Polarity, String) {
    let telling: Vec<&Share> = shares.iter().filter(|share| !share.is_plain()).collect();
    let n = telling.len().max(1) as f64;
    let border = telling.iter().map(|s| s.border).sum::<f64>() / n;
    let centre = telling.iter().map(|s| s.centre).sum::<f64>() / n;
    let white_votes = telling.iter().filter(|s| s.centre > s.border).count();
    let black_votes = telling.iter().filter(|s| s.centre < s.border).count();
    let polarity = if black_votes > white_votes {
        Polarity::BlackIsObject
    } else {
        Polarity::WhiteIsObject
    };
    let votes = white_votes.max(black_votes);
    // Photographers put the object in the middle; where they did not, say so.
    let unsure = votes * 4 < telling.len() * 3 || (centre - border).abs() < 0.05;
    let sentence = format!(
        "{polarity}: on average {:.0} % of the centre and {:.0} % of the border are white, {votes} of {} masks agree{}",
        centre * 100.0,
        border * 100.0,
        telling.len(),
        if unsure {
            "; this is not certain, state the polarity if it is wrong"
        } else {
            ""
        }
    );
    (polarity, sentence)
}
