//! Exports appear whole, replace only exports, and say what they are.

use crate::rig::{Rig, listing};
use scene_export::{Existing, ExportError, MaskTool, Options, Product, Target, export};
use std::fs;
use std::time::Duration;

const PRODUCT: Product = Product::Files(Target::Alpha8);

fn replace() -> Options {
    Options {
        existing: Existing::Replace,
        ..Options::default()
    }
}

#[test]
fn an_earlier_export_is_replaced_only_on_request() {
    let rig = Rig::new();
    rig.export(PRODUCT).unwrap();
    fs::write(rig.out().join("mine.txt"), "x").unwrap();
    let before = listing(&rig.out());
    let error = rig.export(PRODUCT).unwrap_err();
    assert!(matches!(error, ExportError::Exists { .. }));
    assert!(error.to_string().contains("--force"), "{error}");
    assert_eq!(listing(&rig.out()), before);

    // Not with what somebody else has put there.
    let error = export(&rig.run(), PRODUCT, &rig.out(), &replace()).unwrap_err();
    let said = error.to_string();
    assert!(
        said.contains("not exported, mine.txt: it is never replaced; move that elsewhere"),
        "{said}"
    );
    assert_eq!(listing(&rig.out()), before);
    fs::remove_file(rig.out().join("mine.txt")).unwrap();

    let mesh = Product::Files(Target::Obj);
    export(&rig.run(), mesh, &rig.out(), &replace()).unwrap();
    assert_eq!(listing(&rig.out()), ["export.txt", "mesh.obj"]);
    let record = fs::read_to_string(rig.out().join("export.txt")).unwrap();
    assert!(record.starts_with("obj, exported by sos "), "{record}");
    // Nothing is left beside it.
    let beside = rig.out().parent().unwrap().to_path_buf();
    assert_eq!(fs::read_dir(beside).unwrap().count(), 2);
}

#[test]
fn what_was_not_exported_is_never_replaced() {
    let rig = Rig::new();
    fs::create_dir_all(rig.out()).unwrap();
    fs::write(rig.out().join("thesis.tex"), "x").unwrap();
    let error = export(&rig.run(), PRODUCT, &rig.out(), &replace()).unwrap_err();
    let said = error.to_string();
    assert!(
        said.contains("such as thesis.tex") && said.contains("never replaced"),
        "{said}"
    );
    assert_eq!(listing(&rig.out()), ["thesis.tex"]);
    fs::remove_file(rig.out().join("thesis.tex")).unwrap();
    // All that an export leaves that was killed.
    let left = rig.out().join(".sos-partial-a1B2c3");
    fs::create_dir(&left).unwrap();
    let error = export(&rig.run(), PRODUCT, &rig.out(), &replace()).unwrap_err();
    let said = error.to_string();
    assert!(
        said.contains(".sos-partial-a1B2c3") && said.contains("delete"),
        "{said}"
    );
    fs::remove_dir(&left).unwrap();
    // An empty folder is as good as none.
    export(&rig.run(), PRODUCT, &rig.out(), &replace()).unwrap();
    // A file is in the way.
    let file = rig.out().join("000.png");
    let error = export(&rig.run(), PRODUCT, &file, &replace()).unwrap_err();
    assert!(error.to_string().contains("this is a file"), "{error}");
}

#[test]
fn a_failed_export_leaves_nothing_and_keeps_the_old_one() {
    let rig = Rig::new();
    rig.export(PRODUCT).unwrap();
    let before = listing(&rig.out());
    fs::remove_file(rig.run().join("depth/001.exr")).unwrap();
    let exr = Product::Files(Target::Exr);
    let error = export(&rig.run(), exr, &rig.out(), &replace()).unwrap_err();
    assert!(error.to_string().contains("001.exr"), "{error}");
    assert_eq!(listing(&rig.out()), before);
    let beside = rig.out().parent().unwrap().to_path_buf();
    assert_eq!(fs::read_dir(beside).unwrap().count(), 2);
}

#[test]
fn exports_go_into_the_run_unless_stated() {
    let rig = Rig::new();
    let before = listing(&rig.run());
    let product = Product::Masks(MaskTool::InstantNgp);
    let out = product.default_folder(&rig.run());
    assert_eq!(out, rig.run().join("export/masks-instant-ngp"));
    let written = export(&rig.run(), product, &out, &Options::default()).unwrap();
    assert!(
        written
            .sentence(product)
            .ends_with("4 masks for instant-ngp")
    );
    let after: Vec<String> = listing(&rig.run())
        .into_iter()
        .filter(|file| !file.starts_with("export/"))
        .collect();
    assert_eq!(after, before, "the run's own files are untouched");
}

#[test]
fn what_others_wrote_into_an_export_is_never_replaced() {
    let rig = Rig::new();
    let product = Product::Masks(MaskTool::Brush);
    rig.export(product).unwrap();
    let again = || export(&rig.run(), product, &rig.out(), &replace());
    // A photo that is looked at, and one that is touched up, are no work of others.
    fs::write(rig.out().join("images/.DS_Store"), "x").unwrap();
    fs::write(rig.out().join("masks/000.png"), "x").unwrap();
    fs::create_dir_all(rig.out().join("checkpoints/empty")).unwrap();
    again().unwrap();
    assert!(!rig.out().join("checkpoints").exists());
    let exported = listing(&rig.out());
    for name in ["a.npy", "b.npy", "c/d.png", "images/e.png"] {
        let path = rig.out().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "hours of work").unwrap();
    }
    let said = again().unwrap_err().to_string();
    assert!(
        said.contains("not exported, a.npy, b.npy, c/d.png and 1 more: "),
        "{said}"
    );
    assert_eq!(listing(&rig.out()).len(), exported.len() + 4);
    // The record names everything but itself.
    let record = fs::read_to_string(rig.out().join("export.txt")).unwrap();
    let names: Vec<&str> = record
        .lines()
        .filter_map(|l| l.strip_prefix("  "))
        .collect();
    let others: Vec<&String> = exported
        .iter()
        .filter(|name| *name != "export.txt")
        .collect();
    assert_eq!(names, others);
}

#[test]
fn exports_that_do_not_list_their_files_are_replaced_unless_something_is_newer() {
    let rig = Rig::new();
    let again = || export(&rig.run(), PRODUCT, &rig.out(), &replace());
    rig.export(PRODUCT).unwrap();
    let path = rig.out().join("export.txt");
    let earlier = || {
        let record = fs::read_to_string(&path).unwrap();
        let (text, _) = record.split_once("\nFiles").unwrap();
        fs::write(&path, text).unwrap();
    };
    earlier();
    let mine = rig.out().join("poses_bounds.npy");
    fs::write(&mine, "x").unwrap();
    let later = fs::metadata(&path).unwrap().modified().unwrap() + Duration::from_secs(5);
    let file = fs::File::options().write(true).open(&mine).unwrap();
    file.set_modified(later).unwrap();
    let said = again().unwrap_err().to_string();
    assert!(said.contains("not exported, poses_bounds.npy: "), "{said}");
    fs::remove_file(&mine).unwrap();
    again().unwrap();
}

#[test]
fn what_is_decided_about_the_scene_is_said_once() {
    let rig = Rig::new();
    rig.remodel(|model| {
        let half = model.cameras[&1].scaled_to(20, 15);
        model.cameras.insert(1, half);
    });
    let products = [Target::Coco, Target::ColmapScene].map(Product::Files);
    let products = products
        .into_iter()
        .chain(MaskTool::ALL.map(Product::Masks));
    for product in products.filter(|product| *product != Product::Masks(MaskTool::SpinNerf)) {
        let written = rig.export(product).unwrap();
        let says = |text: &str| text.contains("camera 1 is stated for 20x15");
        let count = written.notes.iter().filter(|note| says(note)).count();
        assert_eq!(count, 1, "{product}: {:?}", written.notes);
        let record = fs::read_to_string(rig.out().join("export.txt")).unwrap();
        assert!(says(&record), "{record}");
        fs::remove_dir_all(rig.out()).unwrap();
    }
}
