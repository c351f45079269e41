//! Exports appear whole, replace only exports, and say what they are.

use crate::rig::{Rig, listing};
use scene_export::{Existing, ExportError, MaskTool, Options, Product, Target, export};
use std::fs;

const PRODUCT: Product = Product::Files(Target::Alpha8);

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

    let replace = Options {
        existing: Existing::Replace,
        ..Options::default()
    };
    let mesh = Product::Files(Target::Obj);
    export(&rig.run(), mesh, &rig.out(), &replace).unwrap();
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
    let replace = Options {
        existing: Existing::Replace,
        ..Options::default()
    };
    let error = export(&rig.run(), PRODUCT, &rig.out(), &replace).unwrap_err();
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
    let error = export(&rig.run(), PRODUCT, &rig.out(), &replace).unwrap_err();
    let said = error.to_string();
    assert!(
        said.contains(".sos-partial-a1B2c3") && said.contains("delete"),
        "{said}"
    );
    fs::remove_dir(&left).unwrap();
    // An empty folder is as good as none.
    export(&rig.run(), PRODUCT, &rig.out(), &replace).unwrap();
    // A file is in the way.
    let file = rig.out().join("000.png");
    let error = export(&rig.run(), PRODUCT, &file, &replace).unwrap_err();
    assert!(error.to_string().contains("this is a file"), "{error}");
}

#[test]
fn a_failed_export_leaves_nothing_and_keeps_the_old_one() {
    let rig = Rig::new();
    rig.export(PRODUCT).unwrap();
    let before = listing(&rig.out());
    fs::remove_file(rig.run().join("depth/001.exr")).unwrap();
    let replace = Options {
        existing: Existing::Replace,
        ..Options::default()
    };
    let exr = Product::Files(Target::Exr);
    let error = export(&rig.run(), exr, &rig.out(), &replace).unwrap_err();
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
