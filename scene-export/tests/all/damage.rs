//! Input that cannot be used gives one sentence with the file and the remedy.

use crate::rig::{PLY, Rig, save};
use io_colmap::CameraModel;
use scene_export::{MaskTool, Options, Product, Target, export};
use std::fs;

fn complaint(rig: &Rig, product: Product) -> String {
    rig.complaint(product)
}

/// The remedy for results that are damaged or not there, as the test's paths are written.
fn resumed(rig: &Rig) -> String {
    format!("sos train --resume --out {}", rig.run().display())
}

#[test]
fn folders_without_a_finished_run_are_refused() {
    let rig = Rig::new();
    let nothing = rig.run().join("scene");
    let product = Product::Files(Target::Exr);
    let error = export(&nothing, product, &rig.out(), &Options::default()).unwrap_err();
    assert!(
        error.to_string().contains("config.toml is missing"),
        "{error}"
    );
    fs::remove_dir_all(rig.run().join("alpha")).unwrap();
    let text = complaint(&rig, product);
    assert!(
        text.contains("no mattes") && text.contains(&resumed(&rig)),
        "{text}"
    );
}

#[cfg(unix)]
#[test]
fn a_closed_sub_folder_costs_no_matte_in_others() {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;
    let rig = Rig::new();
    let close = |name: &str, mode| {
        let folder = rig.run().join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::set_permissions(&folder, Permissions::from_mode(mode)).unwrap();
        fs::read_dir(folder).is_err()
    };
    if !close("alpha/lost+found", 0o000) {
        eprintln!("skipped: this user may read every folder");
        return;
    }
    let (_, written) = rig.files(Target::Alpha8);
    assert_eq!((written.count, written.notes.len()), (4, 1));
    let note = &written.notes[0];
    assert!(
        note.contains("lost+found cannot be read and is left out ("),
        "{note}"
    );
    let record = fs::read_to_string(rig.out().join("export.txt")).unwrap();
    assert!(record.contains(note), "{record}");
    // Nothing is left out where every photo has its matte.
    fs::remove_dir_all(rig.out()).unwrap();
    let (_, written) = rig.files(Target::ColmapScene);
    assert!(
        written
            .notes
            .iter()
            .all(|note| !note.contains("lost+found"))
    );
    fs::remove_dir_all(rig.out()).unwrap();

    // One photo's matte is in there.
    close("alpha/cam2", 0o000);
    let (_, written) = rig.files(Target::Alpha8);
    assert_eq!((written.count, written.notes.len()), (3, 2));
    fs::remove_dir_all(rig.out()).unwrap();
    let text = complaint(&rig, Product::Files(Target::Coco));
    assert!(
        text.contains("no matte of \"cam2/b.c.png\"")
            && text.contains("alpha/cam2 cannot be read (")
            && text.ends_with("; check that you may access it, or choose another place"),
        "{text}"
    );
    for name in ["000.png", "001.png", "002.png"] {
        fs::remove_file(rig.run().join("alpha").join(name)).unwrap();
    }
    let text = complaint(&rig, Product::Files(Target::Alpha8));
    assert!(
        text.contains("no mattes in it yet") && text.contains("alpha/cam2 cannot be read ("),
        "{text}"
    );
    // Where nothing in it can be read, no other place to write to is of use.
    close("alpha", 0o000);
    let text = complaint(&rig, Product::Files(Target::Alpha8));
    assert!(
        text.contains("cannot list") && text.contains("check that you may access it"),
        "{text}"
    );
    for name in ["alpha", "alpha/lost+found", "alpha/cam2"] {
        close(name, 0o700);
    }
}

#[test]
fn damaged_pictures_are_named() {
    let exr = Product::Files(Target::Exr);
    for (file, bytes, says) in [
        ("alpha/001.png", &b"no picture"[..], "alpha/001.png"),
        ("foreground/000.png", b"", "foreground/000.png"),
        (
            "depth/000.exr",
            b"\x76\x2f\x31\x01rest",
            "depth cannot be read",
        ),
    ] {
        let rig = Rig::new();
        fs::write(rig.run().join(file), bytes).unwrap();
        let text = complaint(&rig, exr);
        assert!(
            text.contains(says) && text.contains(&resumed(&rig)),
            "{text}"
        );
    }
    let rig = Rig::new();
    let small = image::RgbImage::new(3, 2);
    save(&rig.run().join("background/002.png"), |path| {
        small.save(path)
    });
    let text = complaint(&rig, exr);
    assert!(text.contains("it is 3x2 but the matte is 40x30"), "{text}");
    assert!(
        text.contains("--config") && text.contains("--force"),
        "{text}"
    );
    let text = {
        let grey = image::GrayImage::new(40, 30);
        save(&rig.run().join("foreground/000.png"), |path| {
            grey.save(path)
        });
        complaint(&rig, Product::Files(Target::ColmapScene))
    };
    assert!(text.contains("no 8-bit RGBA"), "{text}");
}

#[test]
fn damaged_meshes_are_explained() {
    for (ply, says) in [
        ("ply\nformat ascii 1.0\n", "mesh.ply"),
        ("not a mesh at all", "mesh.ply"),
        (
            &PLY.replace("3 0 2 4\n", "3 0 2 6\n"),
            "face 0 names vertex 6 of 6",
        ),
        (
            &PLY.replace("property float x\n", "property float w\n"),
            "vertex 0 has no finite",
        ),
        (&PLY.replace("vertex 6", "vertex 60000000"), "mesh.ply"),
        (
            "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n",
            "no triangles",
        ),
        // Takes no bytes, so that a parser would never come to the end of the file.
        (
            "ply\nformat binary_little_endian 1.0\nelement edge 100000000000\nend_header\n",
            "100000000000 of the element \"edge\", which has no properties",
        ),
    ] {
        let rig = Rig::new();
        fs::write(rig.run().join("mesh.ply"), ply).unwrap();
        for target in [Target::Obj, Target::Glb] {
            let text = complaint(&rig, Product::Files(target));
            assert!(text.contains(says), "{text}");
        }
    }
    let rig = Rig::new();
    fs::remove_file(rig.run().join("mesh.ply")).unwrap();
    let text = complaint(&rig, Product::Files(Target::Glb));
    assert!(text.contains("the run has no mesh"), "{text}");
    let text = complaint(&rig, Product::Masks(MaskTool::Neus));
    assert!(text.contains("the run has no mesh"), "{text}");
    // Tools that can do without a mesh are told which of the two it is.
    let (_, written) = rig.masks(MaskTool::InstantNgp);
    let told = |notes: &[String], says| notes.iter().any(|note| note.contains(says));
    assert!(told(&written.notes, "the run has no mesh"));
    let rig = Rig::new();
    fs::write(rig.run().join("mesh.ply"), "not a mesh at all").unwrap();
    let (_, written) = rig.masks(MaskTool::InstantNgp);
    assert!(told(&written.notes, "mesh.ply") && !told(&written.notes, "no mesh"));
}

#[test]
fn scenes_that_are_not_the_runs_are_refused() {
    let coco = Product::Files(Target::Coco);
    let rig = Rig::new();
    rig.remodel(|model| {
        for view in &mut model.views {
            if view.name == "000.png" {
                view.name = "003.png".to_owned();
            }
        }
    });
    let images = rig.run().join("scene/images");
    fs::copy(images.join("000.png"), images.join("003.png")).unwrap();
    let text = complaint(&rig, coco);
    assert!(
        text.contains("no matte of \"003.png\"") && text.contains("--scene"),
        "{text}"
    );

    let rig = Rig::new();
    let scene = rig.run().join("scene/images");
    for name in crate::rig::PHOTOS {
        let photo = image::RgbImage::new(80, 60);
        save(&scene.join(name), |path| photo.save(path));
    }
    let text = complaint(&rig, coco);
    assert!(text.contains("40x30") && text.contains("80x60"), "{text}");

    let rig = Rig::new();
    fs::rename(rig.run().join("scene"), rig.run().join("moved")).unwrap();
    let text = complaint(&rig, coco);
    assert!(
        text.contains("/nowhere/scene") && text.contains("--scene"),
        "{text}"
    );
    let options = Options {
        scene: Some(rig.run().join("moved")),
        ..Options::default()
    };
    export(&rig.run(), coco, &rig.out(), &options).unwrap();

    // What an earlier run left in the folder is not what this one was made from.
    let rig = Rig::new();
    let config = rig.run().join("config.toml");
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&config, text.replace("demo = true\n", "")).unwrap();
    let text = complaint(&rig, coco);
    assert!(text.contains("/nowhere/scene"), "{text}");

    let rig = Rig::new();
    fs::rename(rig.run().join("scene"), rig.run().join("moved")).unwrap();
    fs::write(rig.run().join("config.toml"), "[input\n").unwrap();
    let text = complaint(&rig, coco);
    assert!(text.contains("no run's configuration"), "{text}");
}

#[test]
fn results_of_a_run_that_was_stopped_are_said_to_be() {
    let rig = Rig::new();
    let product = Product::Files(Target::Alpha8);
    let log = rig.run().join("log.jsonl");
    let end = "{\"step\":9,\"event\":\"end\",\"seconds\":1.0}\n";
    for (lines, stopped) in [("{\"step\":9,\"event\":\"start\"}\n", true), (end, false)] {
        fs::write(&log, lines).unwrap();
        let mesh = rig.run().join("mesh.ply");
        fs::rename(&mesh, mesh.with_extension("kept")).unwrap();
        let without = complaint(&rig, Product::Files(Target::Obj));
        fs::rename(mesh.with_extension("kept"), &mesh).unwrap();
        // Going on with what has ended would find no surface again.
        assert_eq!(
            without.contains("let it come to its end"),
            stopped,
            "{without}"
        );
        assert_ne!(without.contains("found no surface"), stopped, "{without}");
        let written = rig.export(product).unwrap();
        fs::remove_dir_all(rig.out()).unwrap();
        let says = |note: &String| note.contains("its end") && note.contains(&resumed(&rig));
        assert_eq!(
            written.notes.iter().any(says),
            stopped,
            "{:?}",
            written.notes
        );
    }
}

#[test]
fn lenses_that_a_tool_does_not_know_are_refused() {
    let rig = Rig::new();
    rig.remodel(|model| {
        let camera = model.cameras.get_mut(&1).unwrap();
        camera.model = CameraModel::Fov;
        camera.params.push(0.1);
    });
    for tool in [MaskTool::Nerfstudio, MaskTool::InstantNgp, MaskTool::Neus] {
        let text = complaint(&rig, Product::Masks(tool));
        assert!(
            text.contains("FOV") && text.contains("image_undistorter"),
            "{text}"
        );
    }
    let rig = Rig::new();
    rig.remodel(|model| {
        let mut other = model.cameras[&1].clone();
        other.id = 2;
        other.model = CameraModel::OpenCvFisheye;
        other.params.extend([0.1, 0.0, 0.0, 0.0]);
        model.cameras.insert(2, other);
        model.views[1].camera_id = 2;
    });
    let text = complaint(&rig, Product::Masks(MaskTool::Nerfstudio));
    assert!(text.contains("mixes fisheye"), "{text}");
}

#[test]
fn photos_of_two_sizes_are_refused_where_a_tool_has_one() {
    let rig = Rig::new();
    rig.remodel(|model| {
        let mut other = model.cameras[&1].scaled_to(80, 60);
        other.id = 2;
        model.cameras.insert(2, other);
        model.views[1].camera_id = 2;
    });
    let photo = image::RgbImage::new(80, 60);
    save(&rig.run().join("scene/images/001.JPG"), |path| {
        photo.save(path)
    });
    rig.rename("cam2/b.c.png", "004.png");
    for tool in [MaskTool::Neus, MaskTool::SpinNerf] {
        let text = complaint(&rig, Product::Masks(tool));
        assert!(
            text.contains("001.JPG")
                && text.contains("this is 80x60 but the first 40x30; scale the photos to one size"),
            "{text}"
        );
    }
}

#[test]
fn names_that_brush_would_mix_up_are_refused() {
    let rig = Rig::new();
    rig.rename("cam2/b.c.png", "cam2/000.PNG");
    let text = complaint(&rig, Product::Masks(MaskTool::Brush));
    assert!(
        text.contains("cam2/000.PNG: ") && text.contains("mix this one up with \"000.png\""),
        "{text}"
    );
    // Other tools read them, and Brush is one of those that read cut-outs.
    rig.masks(MaskTool::Nerfstudio);
    fs::remove_dir_all(rig.out()).unwrap();
    let (_, written) = rig.files(Target::ColmapScene);
    let told = |notes: &[String]| {
        notes
            .iter()
            .any(|note| note.contains("for Brush, rename \"cam2/000.png\""))
    };
    assert!(told(&written.notes), "{:?}", written.notes);
    let (_, written) = Rig::new().files(Target::ColmapScene);
    assert!(!told(&written.notes), "{:?}", written.notes);
}
