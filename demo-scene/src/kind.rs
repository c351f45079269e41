//! Which scene: the demo, and some that are hard in one way each.

use serde::{Deserialize, Serialize};

/// What stands there and where it is seen from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum SceneKind {
    /// The watering can on its table, from all around: the demo.
    #[default]
    Can,
    /// The same can from a patch of places a quarter as wide as they are far, before a bookshelf: what is behind its
    /// handles is seen through them alone, and its back by nobody.
    OneSide,
    /// A chair of thin legs, a hoop and a wire on a rug: parts of two to four pixels.
    Thin,
    /// The can in its table's colour before plain walls: hardly anything to match.
    Plain,
    /// A spray bottle with a neck as clear as glass, among things: its head hangs in the air.
    Apart,
    /// The can on a turntable before cameras that stand still: only it and the disc turn, and the light stays.
    Turntable,
}
