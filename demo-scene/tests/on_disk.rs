//! What `DemoScene::write` leaves behind.
#![allow(clippy::unwrap_used)]

use demo_scene::{DemoConfig, DemoError, Mesh, generate};

#[test]
fn a_written_scene_is_complete_and_never_overwritten() {
    let scene = generate(&DemoConfig {
        samples_per_pixel: 1,
        ..DemoConfig::tiny()
    });
    let root = tempfile::tempdir().unwrap();
    let dir = root.path().join("scene");
    std::fs::create_dir(&dir).unwrap();
    scene.write(&dir).unwrap();
    let count = |folder: &str| std::fs::read_dir(dir.join(folder)).unwrap().count();
    for folder in [
        "images",
        "alpha_gt",
        "background_gt",
        "background_shadow_gt",
    ] {
        assert_eq!(count(folder), 12);
    }
    assert_eq!(count("coarse_masks"), 10);
    assert_eq!(
        std::fs::read_dir(root.path()).unwrap().count(),
        1,
        "something was left behind"
    );
    let photo = image::open(dir.join("images/003.png")).unwrap().to_rgb8();
    assert!(photo == scene.views[3].photo);

    // Every track entry points back at the observation that names the point.
    let read = |name: &str| std::fs::read_to_string(dir.join("sparse/0").join(name)).unwrap();
    let images = read("images.txt");
    let lines: Vec<&str> = images
        .lines()
        .filter(|line| !line.starts_with('#'))
        .collect();
    assert_eq!(lines.len(), 24);
    for line in read("points3D.txt")
        .lines()
        .filter(|line| !line.starts_with('#'))
    {
        let words: Vec<&str> = line.split(' ').collect();
        for track in words[8..].chunks(2) {
            let (image, index): (usize, usize) =
                (track[0].parse().unwrap(), track[1].parse().unwrap());
            let seen: Vec<&str> = lines[2 * image - 1].split(' ').collect();
            assert_eq!(seen[3 * index + 2], words[0]);
        }
    }
    let mesh = Mesh::read(&dir.join("mesh_gt.ply")).unwrap();
    assert_eq!(mesh.triangles, scene.mesh.triangles);
    let farthest = mesh
        .positions
        .iter()
        .zip(&scene.mesh.positions)
        .map(|(read, rendered)| read.distance(*rendered))
        .fold(0.0, f64::max);
    assert_eq!(mesh.positions.len(), scene.mesh.positions.len());
    assert!(farthest < 1e-6, "{farthest} m");

    let error = scene.write(&dir).unwrap_err();
    assert!(matches!(error, DemoError::Occupied { .. }));
    assert!(error.to_string().contains("such as alpha_gt;"), "{error}");
}

#[cfg(feature = "cli")]
#[test]
fn bad_input_ends_with_2_before_anything_is_rendered() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("scene");
    let taken = root.path().join("taken");
    std::fs::create_dir(&taken).unwrap();
    std::fs::write(taken.join("thesis.doc"), "years of work").unwrap();
    let demo = |arguments: &[&str], out: &std::path::Path| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_demo-scene"))
            .args(arguments)
            .arg(out)
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), said)
    };
    for arguments in [
        ["--width", "0"],
        ["--height", "0"],
        ["--views", "0"],
        ["--width", "4294967295"],
    ] {
        let (code, said) = demo(&arguments, &out);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(arguments[0]), "{said}");
    }
    let (code, said) = demo(&[], &taken);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("choose a folder"), "{said}");
    assert!(!out.exists());
    // The smallest that is allowed works.
    let smallest = ["--tiny", "--views", "1", "--width", "1", "--height", "1"];
    let (code, said) = demo(&smallest, &out);
    assert_eq!(code, Some(0), "{said}");
}
