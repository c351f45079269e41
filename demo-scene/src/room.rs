//! The room: table, floor, walls and furniture. All of it is exact boxes, in the stage frame
//! (origin in the middle of the table top, z up, metres); the detail is painted on.

use glam::{DVec2, DVec3};

use crate::noise::{fbm2, floor, hash3, smoothstep, unit, value2};
use crate::paint::{Material, mix, mottle, rgb};

/// Corners of the room.
pub(crate) const ROOM_LOW: DVec3 = DVec3::new(-2.3, -2.0, -0.75);
pub(crate) const ROOM_HIGH: DVec3 = DVec3::new(2.1, 2.2, 1.85);

/// What a table's top is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Top {
    Wood,
    /// Covered with a rug.
    Rug,
    /// One colour.
    Plain,
}

/// A box-shaped piece of furniture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Furniture {
    TableTop(Top),
    TableLeg,
    Bookshelf,
    Sideboard,
    Cushion,
    Picture,
    Stool,
}

impl Furniture {
    /// Colour at `p`, relative to the centre of the piece, with normal `n`.
    pub(crate) fn material(self, p: DVec3, n: DVec3, half: DVec3) -> Material {
        match self {
            Self::TableTop(Top::Wood) => table_wood(p, n),
            Self::TableTop(Top::Rug) => Material::matt(rug_pile(p.truncate(), 0.5)),
            Self::TableTop(Top::Plain) => Material {
                albedo: rgb(0xbfb095),
                gloss: 0.05,
                sharpness: 4,
            },
            Self::TableLeg => Material::matt(mix(
                rgb(0x5f3a20),
                rgb(0x3f2514),
                grain(DVec2::new(p.z, p.x + p.y), 204),
            )),
            Self::Bookshelf => bookshelf(p, n, half),
            Self::Sideboard => sideboard(p, n, half),
            Self::Cushion => cushion(p),
            Self::Picture => picture(p, half),
            Self::Stool => {
                let wood = mix(
                    rgb(0xb98a55),
                    rgb(0x7d5630),
                    grain(DVec2::new(p.x, p.y), 206),
                );
                Material::matt(wood)
            }
        }
    }
}

/// Dark share of a board whose fibres run along x: bands of growth, long streaks, short pores.
fn grain(q: DVec2, seed: u32) -> f64 {
    let warp = fbm2(q * DVec2::new(1.6, 7.0), 3, seed);
    let rings = value2(DVec2::new(q.x * 0.8, q.y * 55.0 + 7.0 * warp), seed + 5);
    let streaks = fbm2(q * DVec2::new(9.0, 150.0), 3, seed + 9);
    (0.45 + 0.30 * rings + 0.28 * streaks + 0.25 * warp).clamp(0.0, 1.0)
}

fn table_wood(p: DVec3, n: DVec3) -> Material {
    let edge = n.z < 0.5;
    // Boards of unequal width, their joints slightly wavy.
    let y = p.y + 0.0008 * value2(DVec2::new(p.x * 6.0, 0.0), 210);
    const JOINTS: [f64; 8] = [-0.5, -0.372, -0.231, -0.118, 0.028, 0.155, 0.297, 0.5];
    let board = JOINTS.iter().filter(|joint| **joint < y).count() as u32;
    let h = |k: i32| unit(hash3(board as i32, k, 3, 211));
    let joint = JOINTS
        .iter()
        .map(|joint| (joint - y).abs())
        .fold(f64::MAX, f64::min);
    // Knots bend the fibres around them.
    let mut q = DVec2::new(p.x + 3.0 * h(1), y + 0.7 * h(2));
    let mut knot_dark = 0.0_f64;
    for k in 0..3 {
        let at = DVec2::new(
            -0.7 + 1.4 * h(10 + k),
            JOINTS[board.clamp(1, 7) as usize] - 0.02 - 0.09 * h(20 + k),
        );
        let from = (DVec2::new(p.x, y) - at) * DVec2::new(0.55, 1.0);
        let size = 0.006 + 0.008 * h(30 + k);
        let near = size * size / (from.length_squared() + size * size);
        q.y += near * 1.5 * from.y;
        knot_dark = knot_dark.max(smoothstep(1.3, 0.5, from.length() / size));
    }
    let dark = grain(q, 212 + 31 * board);
    let tone = 0.82 + 0.34 * h(3);
    let mut colour = mix(rgb(0xba8d5e), rgb(0x67442a), dark) * tone;
    colour = mix(colour, rgb(0x3a2010), 0.75 * knot_dark);
    let pores = smoothstep(0.28, 0.62, fbm2(q * DVec2::new(45.0, 330.0), 2, 213));
    colour *= 1.0 - 0.42 * pores;
    colour *= 1.0 - 0.7 * smoothstep(0.0022, 0.0006, joint);
    // Scratches and rings left by cups.
    let scratch = value2(
        DVec2::new(p.x * 7.0 + p.y * 3.0, (p.y - 0.6 * p.x) * 240.0),
        214,
    );
    colour *= 1.0 + 0.35 * smoothstep(0.86, 0.98, scratch);
    for (x, y, r) in [
        (-0.27, -0.24, 0.036),
        (0.31, 0.13, 0.041),
        (-0.10, 0.36, 0.034),
    ] {
        let d = (DVec2::new(p.x - x, p.y - y).length() - r).abs();
        colour *= 1.0
            - 0.25
                * smoothstep(0.003, 0.001, d)
                * smoothstep(-0.5, 0.3, fbm2(p.truncate() / 0.02, 2, 215));
    }
    colour = mottle(colour, p, 0.0045, 0.13, 216);
    Material {
        albedo: colour * if edge { 0.8 } else { 1.0 },
        gloss: 0.10,
        sharpness: 4,
    }
}

fn bookshelf(p: DVec3, n: DVec3, half: DVec3) -> Material {
    let frame = mix(
        rgb(0x8a6238),
        rgb(0x54381c),
        grain(DVec2::new(p.z + p.y, p.x), 220),
    );
    if n.y > -0.5 {
        return Material::matt(frame);
    }
    const PITCH: f64 = 0.30;
    let height = p.z + half.z;
    let shelf = floor(height / PITCH);
    let v = height - f64::from(shelf) * PITCH;
    if v < 0.025 || half.x - p.x.abs() < 0.03 || p.x.abs() < 0.012 {
        return Material::matt(frame);
    }
    // Books of unequal width: a cell of 0.14 m split at hashed places.
    let cell = floor(p.x / 0.14);
    let u = p.x / 0.14 - f64::from(cell);
    let mut cuts = [0.0, 0.0, 0.0, 0.0, 1.0];
    for (k, cut) in cuts.iter_mut().enumerate().take(4).skip(1) {
        *cut = 0.25 * (k as f64 + 0.5 * (unit(hash3(cell, shelf, k as i32, 221)) - 0.5));
    }
    let index = cuts.iter().skip(1).filter(|cut| **cut < u).count();
    let h = |k: i32| unit(hash3(cell * 5 + index as i32, shelf, k, 222));
    let top = 0.17 + 0.09 * h(1);
    if v > top || h(2) < 0.06 {
        return Material::matt(rgb(0x1d130b) * (0.6 + 0.8 * (v - top).abs()));
    }
    const SPINES: [u32; 9] = [
        0x8c2f2b, 0x2c4a6b, 0x3e6244, 0xcaa45a, 0xd9cfb8, 0x5b3f6b, 0x2a2c33, 0xb8632f, 0x6e8a92,
    ];
    let round = ((u - cuts[index]) / (cuts[index + 1] - cuts[index])).clamp(0.0, 1.0);
    let mut colour = rgb(SPINES[(h(3) * 9.0) as usize % 9]) * (0.45 + 2.0 * round * (1.0 - round));
    let accent = rgb(SPINES[(h(4) * 9.0) as usize % 9]);
    let band = (v - top * (0.2 + 0.6 * h(5))).abs();
    if band < 0.006 + 0.02 * h(6) && round > 0.12 && round < 0.88 {
        colour = mix(colour, accent, 0.85);
    }
    let title = value2(DVec2::new(v * 110.0, round * 3.0 + 9.0 * h(7)), 223);
    if title > 0.25 && (v - 0.5 * top).abs() < 0.3 * top && (round - 0.5).abs() < 0.25 {
        colour = mix(colour, rgb(0xe8dcb8), 0.7);
    }
    Material::matt(mottle(colour, p, 0.018, 0.35, 224))
}

fn sideboard(p: DVec3, n: DVec3, half: DVec3) -> Material {
    let mut colour = mix(
        rgb(0x9fb0a0),
        rgb(0x7f9486),
        smoothstep(-0.4, 0.4, fbm2(DVec2::new(p.y + p.x, p.z) / 0.09, 5, 230)),
    );
    // Worn paint: the wood shows in patches, more so near the edges of the doors.
    let wood = mix(
        rgb(0x7d5a35),
        rgb(0x4d331a),
        grain(DVec2::new(p.z, p.y + p.x), 231),
    );
    let door = (p.y / (half.y * 0.5)).abs() % 1.0;
    let edge = door.min(1.0 - door) * half.y * 0.5;
    let wear =
        fbm2(DVec2::new(p.y + 2.0 * p.x, p.z) / 0.03, 4, 232) + 0.5 * smoothstep(0.05, 0.0, edge);
    colour = mix(colour, wood, smoothstep(0.36, 0.46, wear));
    if n.x > 0.5 {
        colour *= 1.0 - 0.75 * smoothstep(0.006, 0.003, edge);
        let knob = DVec2::new(edge - 0.06, p.z - 0.05).length();
        colour = mix(colour, rgb(0xb08d3c), smoothstep(0.019, 0.015, knob));
    }
    Material::matt(mottle(colour, p, 0.012, 0.25, 233))
}

fn cushion(p: DVec3) -> Material {
    let weave = value2(DVec2::new((p.x + p.z) / 0.011, (p.y - p.z) / 0.011), 240);
    let check = (floor((p.x + p.z) / 0.09) + floor((p.y + 0.3 * p.z) / 0.09)) & 1;
    let base = if check == 0 {
        rgb(0x7b8b9c)
    } else {
        rgb(0x5f6f84)
    };
    let accent = mottle(base, p, 0.04, 0.45, 241);
    Material::matt(accent * (1.0 + 0.3 * weave))
}

fn picture(p: DVec3, half: DVec3) -> Material {
    let q = DVec2::new(p.x, p.z) / DVec2::new(half.x, half.z);
    let frame = q.abs().max_element();
    let gilt = mix(
        rgb(0x9a7430),
        rgb(0x5d4119),
        smoothstep(-0.3, 0.3, fbm2(q * 30.0, 3, 250)),
    );
    let m = DVec2::new(p.x, p.z);
    let s = fbm2(m / 0.16, 5, 251);
    let sky = mix(
        rgb(0xd6b98a),
        rgb(0x7f9fb5),
        smoothstep(-0.2, 0.7, q.y + 0.4 * s),
    );
    let field = mix(
        rgb(0x6f7d3a),
        rgb(0x3d5230),
        smoothstep(-0.3, 0.3, fbm2(m / 0.05, 4, 252)),
    );
    let scene = if q.y + 0.5 * s < -0.05 { field } else { sky };
    let colour = if frame > 0.9 {
        gilt
    } else if frame > 0.78 {
        rgb(0xe2d9c4)
    } else {
        scene
    };
    Material::matt(mottle(colour, p, 0.014, 0.25, 253))
}

/// Colour of a shell without any pattern.
pub(crate) fn plain_shell_material(n: DVec3) -> Material {
    Material::matt(if n.z > 0.5 {
        rgb(0x8a8378)
    } else {
        rgb(0xcfc8ba)
    })
}

/// Colour of the room's shell at `p` with inward normal `n`.
pub(crate) fn shell_material(p: DVec3, n: DVec3) -> Material {
    if n.z > 0.5 {
        return floor_boards(p);
    }
    if n.z < -0.5 {
        return Material::matt(mottle(rgb(0xe8e2d6), p, 0.05, 0.08, 260));
    }
    let along = if n.x.abs() > 0.5 { p.y } else { p.x + 11.0 };
    let q = DVec2::new(along, p.z);
    let height = p.z - ROOM_LOW.z;
    if height < 0.11 {
        let board = mottle(rgb(0xd9d2c2), p, 0.02, 0.2, 261);
        return Material::matt(board * (1.0 - 0.6 * smoothstep(0.095, 0.108, height)));
    }
    let plaster = mix(
        rgb(0xcdb994),
        rgb(0xb39a74),
        smoothstep(-0.5, 0.5, fbm2(q / 0.25, 6, 262)),
    );
    // Wallpaper: sprigs in staggered cells, each a little different.
    let row = floor(q.y / 0.11);
    let x = q.x / 0.11 + 0.5 * f64::from(row & 1);
    let column = floor(x);
    let h = |k: i32| unit(hash3(column, row, k, 263)) - 0.5;
    let from = DVec2::new(
        x - f64::from(column) - 0.5,
        q.y / 0.11 - f64::from(row) - 0.5,
    ) - 0.2 * DVec2::new(h(1), h(2));
    let petals = 0.10 + 0.05 * h(3);
    let d = (from.abs() - DVec2::splat(petals))
        .length()
        .min(from.length())
        - 0.075;
    let sprig = mix(rgb(0x8c3f35), rgb(0x4f6a4a), smoothstep(-0.2, 0.2, h(4)));
    let mut colour = mix(plaster, sprig, 0.8 * smoothstep(0.02, -0.02, d));
    let stem = (from.x - 0.1 * value2(DVec2::new(q.y * 20.0, x), 264)).abs();
    colour = mix(colour, rgb(0x5d6b46), 0.6 * smoothstep(0.035, 0.015, stem));
    Material::matt(mottle(colour, p, 0.013, 0.22, 265))
}

fn floor_boards(p: DVec3) -> Material {
    // A rug under the table.
    let q = DVec2::new(0.96 * p.x + 0.28 * p.y, 0.96 * p.y - 0.28 * p.x);
    let rug = DVec2::new(1.35, 0.95) - q.abs();
    if rug.min_element() > 0.0 {
        return Material::matt(rug_pile(q, rug.min_element()));
    }
    let row = floor(p.x / 0.13);
    let offset = p.y / 0.9 + 7.0 * unit(hash3(row, 0, 0, 270));
    let plank = floor(offset);
    let h = unit(hash3(row, plank, 1, 271));
    let dark = grain(DVec2::new(p.y + 5.0 * h, 0.4 * p.x + 3.0 * h), 272);
    let mut colour = mix(rgb(0xa27a4e), rgb(0x5e3d22), dark) * (0.65 + 0.6 * h);
    let gap = (p.x / 0.13 - f64::from(row)).min(8.0 * (offset - f64::from(plank)));
    colour *= 1.0 - 0.7 * smoothstep(0.05, 0.015, gap);
    Material {
        albedo: mottle(colour, p, 0.012, 0.25, 273),
        gloss: 0.08,
        sharpness: 3,
    }
}

fn rug_pile(q: DVec2, inwards: f64) -> DVec3 {
    let tuft = fbm2(q / 0.013, 2, 280);
    let wear = fbm2(q / 0.22, 4, 281);
    let red = mix(rgb(0x7d2c26), rgb(0x5a1f22), smoothstep(-0.3, 0.3, wear));
    let cream = rgb(0xcdb98c);
    let navy = rgb(0x2a3450);
    let mut colour = red;
    if inwards < 0.05 || (inwards - 0.2).abs() < 0.02 {
        colour = cream;
    } else if inwards < 0.18 {
        let s = (q.x + q.y) / 0.07;
        let v = (s - f64::from(floor(s)) - 0.5).abs() + 0.3 * value2(q / 0.05, 282);
        colour = if v < 0.26 { cream } else { navy };
    } else {
        let cell = DVec2::new(q.x / 0.16, q.y / 0.16);
        let (i, j) = (floor(cell.x), floor(cell.y));
        let from = cell - DVec2::new(f64::from(i), f64::from(j)) - 0.5;
        let h = unit(hash3(i, j, 0, 283));
        let diamond = from.x.abs() + from.y.abs();
        if (diamond - 0.36).abs() < 0.05 {
            colour = cream;
        } else if diamond < 0.14 + 0.12 * h {
            colour = if h > 0.5 { navy } else { rgb(0xb5802f) };
        }
    }
    colour * (1.0 + 0.45 * tuft) * (1.0 + 0.2 * wear)
}
