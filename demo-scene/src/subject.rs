//! What the target is: its shape and paint, in its own frame.

use glam::DVec3;

use crate::bottle;
use crate::chair;
use crate::kind::SceneKind;
use crate::paint::{Material, mottle, rgb};
use crate::watering_can;

/// The thing that is to be cut out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Subject {
    Can,
    /// The can in the colour of its table.
    PlainCan,
    Chair,
    Bottle,
}

impl Subject {
    pub(crate) fn of(kind: SceneKind) -> Self {
        match kind {
            SceneKind::Can | SceneKind::OneSide | SceneKind::Turntable => Self::Can,
            SceneKind::Plain => Self::PlainCan,
            SceneKind::Thin => Self::Chair,
            SceneKind::Apart => Self::Bottle,
        }
    }

    /// Half extents and centre of a box around any of them.
    pub(crate) const BOUNDS: (DVec3, DVec3) = (watering_can::HALF, watering_can::CENTRE);

    /// Signed distance (a lower bound with slope at most one).
    pub(crate) fn sdf(self, p: DVec3) -> f64 {
        match self {
            Self::Can | Self::PlainCan => watering_can::sdf(p),
            Self::Chair => chair::sdf(p),
            Self::Bottle => bottle::sdf(p),
        }
    }

    /// The same as if it were solid.
    pub(crate) fn filled_sdf(self, p: DVec3) -> f64 {
        match self {
            Self::Can | Self::PlainCan => watering_can::filled_sdf(p),
            Self::Chair => chair::sdf(p),
            Self::Bottle => bottle::sdf(p),
        }
    }

    /// Paint at a surface point.
    pub(crate) fn material(self, p: DVec3) -> Material {
        match self {
            Self::Can => watering_can::material(p),
            Self::PlainCan => Material::glossy(mottle(rgb(0xc4b69c), p, 0.02, 0.05, 71), 0.15),
            Self::Chair => chair::material(p),
            Self::Bottle => bottle::material(p),
        }
    }
}
