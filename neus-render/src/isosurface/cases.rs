//! How the surface cuts a cube, for each of the 256 ways in which its corners lie in or out.
//!
//! The cases are derived, not listed. On each face of the cube the surface leaves segments; where
//! corners alternate around a face, those inside are kept apart, a choice that depends on the face
//! alone, so that both cubes at it agree. The segments close to loops within the cube. Loops are
//! cut to triangles without a diagonal that lies in a face, because the neighbour could have drawn
//! the same one. Together that makes every edge of the mesh belong to exactly two triangles.
//!
//! Corner `c` has the coordinates `(c & 1, c >> 1 & 1, c >> 2 & 1)`. Edge `4 a + k` runs along axis
//! `a`, with the two bits of `k` the coordinates along the other axes, in ascending order.

use std::sync::LazyLock;

/// Triangles (three cube edges each, counter-clockwise seen from outside) of every case; bit `c`
/// of a case tells that corner `c` is inside.
pub(crate) static CASES: LazyLock<Vec<Vec<[u8; 3]>>> =
    LazyLock::new(|| (0..256).map(triangles).collect());

/// The two corners of an edge, the one with the lower coordinate first.
pub(crate) const fn edge_corners(edge: usize) -> [usize; 2] {
    let (axis, k) = (edge / 4, edge % 4);
    let low = match axis {
        0 => (k & 1) << 1 | (k >> 1) << 2,
        1 => (k & 1) | (k >> 1) << 2,
        _ => k,
    };
    [low, low | 1 << axis]
}

/// The edge between two neighbouring corners.
fn edge_between(a: usize, b: usize) -> usize {
    let ends = [a.min(b), a.max(b)];
    (0..12)
        .find(|&edge| edge_corners(edge) == ends)
        .unwrap_or_else(|| panic!("no edge joins corners {a} and {b}"))
}

/// The corners of a face, counter-clockwise seen from outside the cube.
fn face_corners(axis: usize, side: usize) -> [usize; 4] {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut around = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| side << axis | a << u | b << v);
    if side == 0 {
        around.reverse();
    }
    around
}

fn share_a_face(a: usize, b: usize) -> bool {
    let [a0, a1] = edge_corners(a);
    let [b0, b1] = edge_corners(b);
    (0..3).any(|axis| {
        let coordinates = [a0, a1, b0, b1].map(|corner| corner >> axis & 1);
        coordinates == [0; 4] || coordinates == [1; 4]
    })
}

fn triangles(case: usize) -> Vec<[u8; 3]> {
    let inside = |corner: usize| case >> corner & 1 == 1;
    // For every cut edge, the next one of its loop.
    let mut next = [None; 12];
    for axis in 0..3 {
        for side in 0..2 {
            let around = face_corners(axis, side);
            let corner = |i: usize| around[i % 4];
            for i in 0..4 {
                if inside(corner(i)) || !inside(corner(i + 1)) {
                    continue;
                }
                // A run of inside corners begins after edge i; it ends before edge `last`.
                let mut last = i + 1;
                while inside(corner(last + 1)) {
                    last += 1;
                }
                let entry = edge_between(corner(i), corner(i + 1));
                next[entry] = Some(edge_between(corner(last), corner(last + 1)));
            }
        }
    }
    let mut out = Vec::new();
    for start in 0..12 {
        let mut around = Vec::new();
        let mut edge = start;
        while let Some(following) = next[edge].take() {
            around.push(edge);
            edge = following;
        }
        if around.len() >= 3 {
            let found = cut(&around, 0, around.len() - 1, &mut out);
            assert!(found, "the loop {around:?} has no triangulation");
        }
    }
    out
}

/// Cuts the part of a loop between positions `i` and `j` (whose chord is settled) to triangles.
fn cut(around: &[usize], i: usize, j: usize, out: &mut Vec<[u8; 3]>) -> bool {
    if j == i + 1 {
        return true;
    }
    let allowed = |a: usize, b: usize| b == a + 1 || !share_a_face(around[a], around[b]);
    for k in i + 1..j {
        let before = out.len();
        if allowed(i, k) && allowed(k, j) && cut(around, i, k, out) && cut(around, k, j, out) {
            out.push([around[i], around[k], around[j]].map(|edge| edge as u8));
            return true;
        }
        out.truncate(before);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complementary_cases_cut_the_same_edges() {
        for case in 0..256 {
            let edges = |case: usize| {
                let mut edges: Vec<u8> = CASES[case].iter().flatten().copied().collect();
                edges.sort_unstable();
                edges.dedup();
                edges
            };
            assert_eq!(edges(case), edges(255 - case));
        }
        assert!(CASES[0].is_empty() && CASES[255].is_empty());
    }

    #[test]
    fn a_single_inside_corner_gives_a_triangle_that_faces_away_from_it() {
        let [[a, b, c]] = CASES[1][..] else {
            panic!("one triangle expected")
        };
        let middle = |edge: u8| {
            let [p, q] = edge_corners(edge as usize)
                .map(|c| glam::Vec3::new((c & 1) as f32, (c >> 1 & 1) as f32, (c >> 2) as f32));
            0.5 * (p + q)
        };
        let normal = (middle(b) - middle(a)).cross(middle(c) - middle(a));
        assert!(normal.min_element() > 0.0);
    }
}
