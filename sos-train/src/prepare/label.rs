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

/// What a vote on a mask's edge counts: nothing beside views that see the place well inside or
/// outside, and everything where all views see it at the outline.
pub(super) const EDGE_VOTE: f32 = 0.1;
/// [`Label::Unknown`] where the own mask says object.
pub(super) const UNKNOWN_OBJECT: u8 = 5;
/// [`Label::Unknown`] where the photo is not to be learned from, or the mask is not believed.
pub(super) const SILENT: u8 = 6;
/// [`Label::Unknown`] in the middle of a part that is as thin as the edge, and in the middle of such a gap: nothing of it lies
/// farther inside, so that these pixels vote in full.
pub(super) const THIN_OBJECT: u8 = 7;
pub(super) const THIN_GAP: u8 = 8;
/// [`Label::DoubtfulObject`] where a mask that is set aside says what the others say.
pub(super) const AGREED_OBJECT: u8 = 9;
/// [`Label::DoubtfulObject`] where a photo without a mask that is believed has the object's colours.
pub(super) const ALIKE_OBJECT: u8 = 10;
/// [`Label::Object`] where the photo has the object's colours, too.
pub(super) const ALIKE_MASKED: u8 = 11;
