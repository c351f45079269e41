//! How likely a colour is the object's, by those that are known (as in GrabCut, Rother et al. 2004).

use glam::Vec3;

/// Levels of each channel between which colours are told apart.
const LEVELS: usize = 12;
/// What each bin of colours has at least, as a share of all.
const LEAST_SHARE: f32 = 1e-3;

/// How often each colour is the object's where that is known.
pub(crate) struct Colours {
    /// Of each bin, its share of what is not the object's, and of the object.
    shares: Vec<[f32; 2]>,
}

impl Colours {
    /// Of colours (sRGB in `[0, 1]`), each with how sure it is not the object's and how sure it is.
    pub(crate) fn new(known: impl Iterator<Item = (Vec3, [f32; 2])>) -> Self {
        let mut shares = vec![[0.0; 2]; LEVELS.pow(3)];
        let mut sums = [0.0; 2];
        for (colour, known) in known {
            for (i, known) in known.into_iter().enumerate() {
                shares[Self::bin(colour)][i] += known;
                sums[i] += known;
            }
        }
        for share in &mut shares {
            for i in 0..2 {
                share[i] = share[i] / f32::max(sums[i], 1e-9) + LEAST_SHARE;
            }
        }
        Self { shares }
    }

    fn bin(colour: Vec3) -> usize {
        let level = |value: f32| ((value * LEVELS as f32) as usize).min(LEVELS - 1);
        (level(colour.x) * LEVELS + level(colour.y)) * LEVELS + level(colour.z)
    }

    /// How likely a colour is the object's, and how much that tells.
    pub(crate) fn object(&self, colour: Vec3) -> (f32, f32) {
        let [outside, inside] = self.shares[Self::bin(colour)];
        let likely = inside / (inside + outside);
        (likely, (2.0 * likely - 1.0).powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_tells_as_much_as_it_is_on_one_side() {
        let (red, green, grey) = (Vec3::X, Vec3::Y, Vec3::splat(0.5));
        let known = [
            (red, [0.0, 1.0]),
            (green, [1.0, 0.0]),
            (grey, [0.5, 0.5]),
            (red, [0.0, 1.0]),
        ];
        let colours = Colours::new(known.into_iter());
        let (likely, telling) = colours.object(red);
        assert!(likely > 0.95 && telling > 0.9);
        let (likely, telling) = colours.object(green);
        assert!(likely < 0.05 && telling > 0.9);
        // Seen on both sides, or never.
        assert!(colours.object(grey).1 < 0.1);
        assert_eq!(colours.object(Vec3::Z), (0.5, 0.0));
    }
}
