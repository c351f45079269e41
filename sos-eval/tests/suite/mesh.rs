use crate::assert_near;
use sos_eval::glam::DVec3;
use sos_eval::*;
use std::f64::consts::PI;
use std::fs;

fn rectangle(width: f64, z: f64) -> TriangleMesh {
    let corner = |x: f64, y: f64| DVec3::new(x, y, z);
    TriangleMesh {
        vertices: vec![
            corner(0.0, 0.0),
            corner(width, 0.0),
            corner(width, 1.0),
            corner(0.0, 1.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

fn sphere(radius: f64) -> TriangleMesh {
    let (rings, sectors) = (60_u32, 120_u32);
    let mut mesh = TriangleMesh::default();
    for i in 0..=rings {
        for j in 0..sectors {
            let (polar, azimuth) = (
                PI * f64::from(i) / f64::from(rings),
                2.0 * PI * f64::from(j) / f64::from(sectors),
            );
            let (s, c) = polar.sin_cos();
            mesh.vertices
                .push(radius * DVec3::new(s * azimuth.cos(), s * azimuth.sin(), c));
        }
    }
    for i in 0..rings {
        for j in 0..sectors {
            let at = |i: u32, j: u32| i * sectors + j % sectors;
            mesh.triangles
                .push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles
                .push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

#[test]
fn planes_apart() {
    let score = compare_meshes(&rectangle(1.0, 0.2), &rectangle(1.0, 0.0), 2000, 7).unwrap();
    for d in [
        score.absolute.accuracy_mean,
        score.absolute.completeness_median,
        score.absolute.chamfer,
    ] {
        assert_near(d, 0.2, 1e-12);
    }
    assert_near(score.object_size, 2.0_f64.sqrt(), 1e-12);
    assert_near(score.relative.chamfer, 0.2 / 2.0_f64.sqrt(), 1e-12);
}

#[test]
fn half_a_plane_is_accurate_but_not_complete() {
    let score = compare_meshes(&rectangle(1.0, 0.0), &rectangle(2.0, 0.0), 50_000, 7).unwrap();
    assert_near(score.absolute.accuracy_mean, 0.0, 1e-12);
    // Half of the points lie x - 1 away, uniform in 0..1: mean 0.25, median 0.
    assert_near(score.absolute.completeness_mean, 0.25, 1e-3);
    assert_near(score.absolute.completeness_median, 0.0, 1e-3);
}

#[test]
fn spheres_in_each_other() {
    let score = compare_meshes(&sphere(1.1), &sphere(1.0), 20_000, 3).unwrap();
    // The facets cut at most 1 - cos(pi / 60) = 0.0014 off the radius.
    assert_near(score.absolute.accuracy_mean, 0.1, 2e-3);
    assert_near(score.absolute.completeness_mean, 0.1, 2e-3);
    assert_near(score.absolute.chamfer, 0.1, 2e-3);
}

#[test]
fn a_mesh_is_at_no_distance_from_itself_and_runs_repeat() {
    let ball = sphere(1.0);
    let score = compare_meshes(&ball, &ball, 5000, 1).unwrap();
    assert_near(score.absolute.chamfer, 0.0, 1e-9);
    assert_eq!(sample_surface(&ball, 100, 1), sample_surface(&ball, 100, 1));
    assert_ne!(sample_surface(&ball, 100, 1), sample_surface(&ball, 100, 2));
}

#[test]
fn points_are_spread_by_area() {
    let mut mesh = rectangle(1.0, 0.0);
    let far = rectangle(3.0, 5.0);
    mesh.triangles
        .extend(far.triangles.iter().map(|t| t.map(|i| i + 4)));
    mesh.vertices.extend(far.vertices);
    let points = sample_surface(&mesh, 4000, 11);
    let low = points.iter().filter(|p| p.z == 0.0).count();
    assert!(
        (999..=1001).contains(&low),
        "{low} of 4000 on a quarter of the area"
    );
    let centre: DVec3 = points.iter().filter(|p| p.z == 0.0).sum::<DVec3>() / low as f64;
    assert_near(centre.x, 0.5, 0.03);
    assert_near(centre.y, 0.5, 0.03);
}

#[test]
fn distance_to_a_triangle_equals_a_dense_search() {
    let mesh = TriangleMesh {
        vertices: vec![
            DVec3::new(0.1, 0.2, 0.3),
            DVec3::new(1.2, 0.1, -0.2),
            DVec3::new(0.4, 0.9, 0.5),
        ],
        triangles: vec![[0, 1, 2]],
    };
    let [a, b, c] = [mesh.vertices[0], mesh.vertices[1], mesh.vertices[2]];
    let queries: Vec<DVec3> = (0..125)
        .map(|i| {
            DVec3::new(
                f64::from(i % 5) - 1.5,
                f64::from(i / 5 % 5) - 1.6,
                f64::from(i / 25) - 1.7,
            )
        })
        .collect();
    for (q, d) in queries.iter().zip(distances(&queries, &mesh)) {
        let mut nearest = f64::INFINITY;
        for i in 0..=200 {
            for j in 0..=200 - i {
                let (u, v) = (f64::from(i) / 200.0, f64::from(j) / 200.0);
                nearest = nearest.min(q.distance(a + (b - a) * u + (c - a) * v));
            }
        }
        assert!(
            d <= nearest + 1e-12 && nearest - d < 0.01,
            "{d} against {nearest} at {q}"
        );
    }
}

#[test]
fn degenerate_triangles_do_no_harm_and_empty_meshes_are_told() {
    let mut mesh = rectangle(1.0, 0.0);
    mesh.triangles.push([1, 1, 2]);
    let score = compare_meshes(&mesh, &mesh, 500, 1).unwrap();
    assert_near(score.absolute.chamfer, 0.0, 1e-12);
    let error = compare_meshes(&TriangleMesh::default(), &mesh, 500, 1).unwrap_err();
    assert_eq!(error, EvalError::EmptyMesh { which: "predicted" });
    assert_eq!(TriangleMesh::default().diagonal(), 0.0);
}

const ASCII: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty float y\nproperty float z\n\
element face 1\nproperty list uchar uint vertex_index\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";

#[test]
fn meshes_are_read_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("square.ply");
    fs::write(&path, ASCII).unwrap();
    assert_eq!(read_ply(&path).unwrap(), rectangle(1.0, 0.0));
}

#[test]
fn bad_meshes_are_told_not_panicked_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.ply");
    for (text, clue) in [
        (
            ASCII.replace("0 1 2 3\n", "0 1 2 9\n"),
            "face 0 names vertex 9 of 4",
        ),
        (
            ASCII.replace("1 1 0", "-1e200 1 0"),
            "vertex 2 lies more than 1e30 away",
        ),
        ("not a mesh".into(), "bad.ply"),
    ] {
        fs::write(&path, &text).unwrap();
        let sentence = read_ply(&path).unwrap_err().to_string();
        assert!(sentence.contains(clue), "{sentence}");
        assert!(!sentence.contains('\n'), "{sentence}");
    }
    assert!(read_ply(&folder.path().join("absent.ply")).is_err());
}
