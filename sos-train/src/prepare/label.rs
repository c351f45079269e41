//! What is known of a pixel at the start, and how it is kept.

/// What a pixel is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Label {
    /// Own mask and the other views agree: background, and fit to teach BaCo by itself.
    Background = 0,
    /// The own mask says background, the other views say object: missing, or occluded.
    DoubtfulBackground = 1,
    /// On the coarse edge, or nobody knows.
    Unknown = 2,
    /// The own mask says object, the other views say background.
    DoubtfulObject = 3,
    /// Own mask and the other views agree: object.
    Object = 4,
}

impl Label {
    /// Mask target in `[0, 1]` and its weight.
    #[must_use]
    pub fn target(self) -> (f32, f32) {
        match self {
            Self::Background => (0.0, 1.0),
            Self::DoubtfulBackground => (0.0, 0.3),
            Self::Unknown => (0.0, 0.0),
            Self::DoubtfulObject => (1.0, 0.3),
            Self::Object => (1.0, 1.0),
        }
    }

    pub(super) fn from_byte(byte: u8) -> Self {
        match byte {
            0 => Self::Background,
            1 => Self::DoubtfulBackground,
            3 | AGREED_OBJECT | ALIKE_OBJECT => Self::DoubtfulObject,
            4 | ALIKE_MASKED => Self::Object,
            _ => Self::Unknown,
        }
    }
}

/// What a pixel's mask says about the surface it shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vote {
    /// Whether it is the object's.
    pub object: bool,
    /// How much this counts, up to 1.
    pub weight: f32,
}

/// What says that the object is to be seen on a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shown {
    /// Nothing does.
    #[default]
    No,
    /// The view's mask, away from its outline: one that is believed, or one that is set aside where the others say the same.
    ByMask,
    /// The photo: it has the object's colours where the others, or a mask that is believed as well, have the object.
    ByColour,
}

/// [`Label::Unknown`] where the photo is not to be learned from, or the mask is not believed.
pub(super) const SILENT: u8 = 6;
/// [`Label::DoubtfulObject`] where a mask that is set aside says what the others say.
pub(super) const AGREED_OBJECT: u8 = 7;
/// [`Label::DoubtfulObject`] where a photo without a mask that is believed has the object's colours.
pub(super) const ALIKE_OBJECT: u8 = 8;
/// [`Label::Object`] where the photo has the object's colours, too.
pub(super) const ALIKE_MASKED: u8 = 9;
/// From here on: [`Label::Unknown`] along the own mask's outline, with what the mask says there and what that counts.
const EDGE: u8 = 16;
/// What votes along an outline count, in so many steps.
const EDGE_LEVELS: u8 = 8;

/// The byte of a pixel along its mask's outline, whose vote counts `weight`.
pub(super) fn edge_byte(object: bool, weight: f32) -> u8 {
    let level = (weight * f32::from(EDGE_LEVELS)).round() as u8;
    EDGE + 2 * level.clamp(1, EDGE_LEVELS) + u8::from(object)
}

/// The vote of a pixel along its mask's outline; `None` of others.
pub(super) fn edge_vote(byte: u8) -> Option<Vote> {
    let code = byte.checked_sub(EDGE)?;
    Some(Vote {
        object: code % 2 == 1,
        weight: f32::from(code / 2) / f32::from(EDGE_LEVELS),
    })
}
