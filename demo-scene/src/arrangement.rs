//! What stands where, in the stage frame.

use glam::DVec3;

use crate::clutter::Clutter;
use crate::kind::SceneKind;
use crate::room::{Furniture, Top};

/// Foot of the target on the table and its turn in degrees.
pub(crate) const TARGET_PLACE: (DVec3, f64) = (DVec3::new(0.0, -0.01, 0.0), 24.0);

/// Radius and half height of the turntable.
const TURNTABLE: (f64, f64) = (0.19, 0.012);

/// Piece, middle, turn in degrees, half extents.
pub(crate) fn furniture(kind: SceneKind) -> Vec<(Furniture, DVec3, f64, DVec3)> {
    let v = DVec3::new;
    let top = match kind {
        SceneKind::Can | SceneKind::OneSide | SceneKind::Apart | SceneKind::Turntable => Top::Wood,
        SceneKind::Thin => Top::Rug,
        SceneKind::Plain => Top::Plain,
    };
    // Middle and half extents; from one side it stands just behind the table.
    let shelf = match kind {
        SceneKind::OneSide => (v(0.1, 0.90, 0.05), v(1.0, 0.16, 0.80)),
        _ => (v(0.25, 2.04, -0.10), v(1.0, 0.16, 0.65)),
    };
    // The turntable stands on it, and is as high as other tables.
    let below = match kind {
        SceneKind::Turntable => 2.0 * TURNTABLE.1,
        _ => 0.0,
    };
    let mut pieces = vec![
        (
            Furniture::TableTop(top),
            v(0.0, 0.0, -0.016 - below),
            0.0,
            v(0.75, 0.5, 0.016),
        ),
        (Furniture::Bookshelf, shelf.0, 0.0, shelf.1),
        (
            Furniture::Sideboard,
            v(-2.06, -0.1, -0.35),
            0.0,
            v(0.24, 0.85, 0.40),
        ),
        (
            Furniture::Cushion,
            v(1.65, 0.2, -0.55),
            0.0,
            v(0.42, 0.85, 0.20),
        ),
        (
            Furniture::Cushion,
            v(1.96, 0.2, -0.25),
            0.0,
            v(0.14, 0.95, 0.35),
        ),
        (
            Furniture::Cushion,
            v(1.62, 1.12, -0.35),
            0.0,
            v(0.46, 0.10, 0.28),
        ),
        (
            Furniture::Picture,
            v(0.5, -1.93, -0.35),
            0.0,
            v(0.50, 0.02, 0.40),
        ),
        (
            Furniture::Picture,
            v(-0.62, -1.95, -0.45),
            0.0,
            v(0.30, 0.02, 0.28),
        ),
        (
            Furniture::Stool,
            v(-0.35, -1.05, -0.32),
            25.0,
            v(0.19, 0.19, 0.02),
        ),
        (
            Furniture::Stool,
            v(-1.6, 1.4, -0.42),
            20.0,
            v(0.22, 0.30, 0.33),
        ),
    ];
    for (x, y) in [(-0.68, -0.43), (0.68, -0.43), (-0.68, 0.43), (0.68, 0.43)] {
        pieces.push((
            Furniture::TableLeg,
            v(x, y, -0.391),
            0.0,
            v(0.03, 0.03, 0.359),
        ));
    }
    for (x, y) in [
        (-0.47, -1.10),
        (-0.30, -1.17),
        (-0.40, -0.93),
        (-0.23, -1.0),
    ] {
        pieces.push((
            Furniture::TableLeg,
            v(x, y, -0.545),
            25.0,
            v(0.018, 0.018, 0.205),
        ));
    }
    pieces
}

/// Thing, place of its foot and turn in degrees.
pub(crate) fn clutter(kind: SceneKind) -> Vec<(Clutter, DVec3, f64)> {
    match kind {
        SceneKind::Thin | SceneKind::Plain => return Vec::new(),
        SceneKind::Turntable => {
            let (radius, half) = TURNTABLE;
            let foot = TARGET_PLACE.0 - DVec3::Z * 2.0 * half;
            return vec![(Clutter::Turntable { radius, half }, foot, 0.0)];
        }
        SceneKind::Can | SceneKind::OneSide | SceneKind::Apart => {}
    }
    use Clutter::{Apple, Mug, Orange};
    let v = DVec3::new;
    let book = |x, y, z, cover| {
        let half = v(x, y, z);
        Clutter::Book { half, cover }
    };
    let sheet = |x, y, look| {
        let half = v(x, y, 0.0006);
        Clutter::Sheet { half, look }
    };
    let pencil = |colour| Clutter::Pencil { colour };
    let cube = |look| Clutter::Cube { half: 0.020, look };
    let carton = Clutter::Carton {
        half: v(0.045, 0.030, 0.068),
    };
    vec![
        (book(0.080, 0.115, 0.016, 0), v(0.05, 0.275, 0.0), 78.0),
        (book(0.068, 0.098, 0.013, 1), v(0.04, 0.285, 0.032), 96.0),
        (book(0.062, 0.088, 0.010, 2), v(0.055, 0.28, 0.058), 70.0),
        (book(0.075, 0.105, 0.014, 3), v(-0.36, -0.27, 0.0), 30.0),
        (book(0.085, 0.120, 0.018, 4), v(0.52, -0.28, 0.0), -34.0),
        (Orange, v(0.205, -0.175, 0.0), 0.0),
        (Orange, v(0.275, -0.225, 0.0), 140.0),
        (Apple, v(-0.285, 0.045, 0.0), 30.0),
        (Apple, v(0.50, -0.27, 0.036), 80.0),
        (Mug, v(0.335, 0.055, 0.0), 200.0),
        // Near enough to hide a corner of the target from one low view.
        (carton, v(-0.186, 0.151, 0.0), 28.0),
        (pencil(0xd9a21b), v(0.02, -0.205, 0.0012), 12.0),
        (pencil(0x2f6b45), v(-0.06, -0.262, 0.0012), -24.0),
        (pencil(0xb23a32), v(-0.35, -0.26, 0.028), 70.0),
        (cube(0), v(-0.175, -0.125, 0.0), 15.0),
        (cube(1), v(-0.230, -0.135, 0.0), 52.0),
        (cube(2), v(-0.203, -0.128, 0.040), 35.0),
        (sheet(0.115, 0.085, 1), v(0.03, -0.245, 0.0), 14.0),
        (sheet(0.075, 0.052, 0), v(-0.13, 0.30, 0.0), -38.0),
        (sheet(0.150, 0.110, 3), v(0.50, 0.28, 0.0), 64.0),
        (sheet(0.105, 0.150, 4), v(-0.56, 0.24, 0.0), 10.0),
    ]
}
