//! The report in a real browser, where one is installed.

use crate::fabricated;
use sos_train::audit::{Metrics, audit};
use sos_train::report::{ReportInputs, write_report};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// A page takes a few seconds; a browser that hangs is ended after this.
const LONGEST: Duration = Duration::from_secs(120);

/// Chromium under any of its names, where it works; says so where there is none.
pub(crate) fn chromium() -> Option<PathBuf> {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&paths)
        .flat_map(|folder| {
            ["chromium", "chromium-browser", "google-chrome"].map(|name| folder.join(name))
        })
        .find(|path| path.is_file());
    let Some(browser) = found else {
        println!("skipped: no chromium, chromium-browser or google-chrome on the PATH");
        return None;
    };
    let dir = tempfile::tempdir().unwrap();
    if !dom(&browser, "data:text/html,<p>here</p>", dir.path()).contains("here") {
        println!(
            "skipped: {} shows no page on this machine",
            browser.display()
        );
        return None;
    }
    Some(browser)
}

/// The page's document after its scripts have run; pixels of WebGL are computed on the CPU. `folder`
/// is for the browser to write into.
pub(crate) fn dom(browser: &Path, address: &str, folder: &Path) -> String {
    let said = folder.join("dom.html");
    let mut running = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu-sandbox"])
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .args(["--window-size=1400,1000", "--virtual-time-budget=5000"])
        .arg(format!(
            "--user-data-dir={}",
            folder.join("profile").display()
        ))
        .args(["--dump-dom", address])
        .stdin(Stdio::null())
        .stdout(fs::File::create(&said).unwrap())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while running.try_wait().unwrap().is_none() {
        if begun.elapsed() > LONGEST {
            running.kill().unwrap();
            running.wait().unwrap();
        }
        sleep(Duration::from_millis(50));
    }
    String::from_utf8_lossy(&fs::read(said).unwrap()).into_owned()
}

/// What a person would do, and what it led to, in attributes of the document's root.
const HANDS: &str = r##"<script>
addEventListener("load", () => {
  const said = document.documentElement.dataset;
  const at = (element, x, y) => {
    const box = element.getBoundingClientRect();
    return { clientX: box.left + x * box.width, clientY: box.top + y * box.height, bubbles: true, cancelable: true, pointerId: 7 };
  };
  const inline = document.querySelector("#compare .stage");
  const clip = () => inline.querySelectorAll("img")[1].style.clipPath;
  const before = clip();
  inline.dispatchEvent(new PointerEvent("pointerdown", at(inline, 0.5, 0.5)));
  inline.dispatchEvent(new PointerEvent("pointermove", at(inline, 0.25, 0.5)));
  inline.dispatchEvent(new PointerEvent("pointerup", at(inline, 0.25, 0.5)));
  said.slid = before !== clip();
  document.querySelector("#compare .choice button:nth-child(3)").click();
  said.left = inline.querySelector(".label.left").textContent;
  document.querySelector(".views section:nth-of-type(2) figure img").click();
  const dialog = document.querySelector("dialog");
  said.large = dialog.open;
  const stage = dialog.querySelector(".stage");
  stage.dispatchEvent(new WheelEvent("wheel", { ...at(stage, 0.4, 0.4), deltaY: -400 }));
  said.enlarged = stage.querySelector(".frame").style.transform;
  dialog.close();
  const canvas = document.querySelector("#viewer canvas");
  if (canvas) {
    const look = canvas.dataset.look;
    canvas.dispatchEvent(new PointerEvent("pointerdown", at(canvas, 0.5, 0.5)));
    canvas.dispatchEvent(new PointerEvent("pointermove", at(canvas, 0.7, 0.6)));
    canvas.dispatchEvent(new PointerEvent("pointerup", at(canvas, 0.7, 0.6)));
    canvas.dispatchEvent(new WheelEvent("wheel", { ...at(canvas, 0.5, 0.5), deltaY: 200 }));
    setTimeout(() => { said.turned = look && look !== canvas.dataset.look; }, 300);
  }
});
</script>"##;

#[test]
fn the_report_comes_alive_without_a_fault() {
    let Some(browser) = chromium() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (_, run) = fabricated::run(dir.path(), true);
    let mut inputs = ReportInputs::gather(&run).unwrap();
    let found = audit(&run, &inputs.scene, inputs.masks.as_ref()).unwrap();
    inputs.audit = Some(found.clone());
    let metrics = Metrics {
        scores: None,
        audit: Some(found),
    };
    metrics.write(&run).unwrap();
    write_report(&run, &inputs).unwrap();

    let page = fs::read_to_string(run.report_path()).unwrap();
    let touched = run.root().join("touched.html");
    fs::write(
        &touched,
        page.replace("</body>", &format!("{HANDS}</body>")),
    )
    .unwrap();
    let address = format!("file://{}", touched.display());
    let dom = dom(&browser, &address, dir.path());
    let root = dom
        .split_once("<html")
        .and_then(|(_, rest)| rest.split_once('>'))
        .map_or("", |(root, _)| root);
    assert!(!root.contains("data-errors"), "{root}");
    assert!(root.contains("data-ready=\"slider "), "{root}");
    for led_to in [
        "data-slid=\"true\"",
        "data-left=\"coarse mask\"",
        "data-large=\"true\"",
        "scale(1.8",
    ] {
        assert!(root.contains(led_to), "{led_to} is not in {root}");
    }
    if root.contains("no-webgl") {
        println!("the mesh was not looked at: this browser has no WebGL");
        return;
    }
    assert!(root.contains("viewer "), "{root}");
    assert!(root.contains("data-turned=\"true\""), "{root}");
    assert!(
        dom.contains("data-drawn=\"true\""),
        "nothing of the mesh is to be seen"
    );
}
