//! The programs in `tests/golden/galvo` are what the postprocessor writes, and come out as drawn.
//!
//! `LASERGYM_UPDATE_GOLDEN=1 cargo test -p lasergym-galvo --test golden` writes them anew.

use std::error::Error;
use std::path::PathBuf;

use lasergym_galvo::{
    AnyProgram, HeadKnowledge, LaserControl, PostOptions, ProgramFormat, ScanHead,
    postprocess_text, simulate,
};

/// The golden file `name`, after replacing it by `written` when asked to.
fn golden(name: &str, written: Option<&str>) -> std::io::Result<String> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/galvo");
    let path = folder.join(name);
    if let Some(written) = written
        && std::env::var_os("LASERGYM_UPDATE_GOLDEN").is_some_and(|value| value == "1")
    {
        std::fs::write(&path, written)?;
    }
    Ok(std::fs::read_to_string(&path)?.replace("\r\n", "\n"))
}

#[test]
fn programs() -> Result<(), Box<dyn Error>> {
    let head = ScanHead::default();
    let knowledge = HeadKnowledge::of_head(&head);
    let job = golden("part.apt", None)?;
    for (dialect, control, name) in [
        ("grbl", LaserControl::Delays, "part-grbl.nc"),
        ("grbl", LaserControl::Inline, "part-inline.nc"),
        ("linuxcnc", LaserControl::Delays, "part-linuxcnc.nc"),
        ("mach4", LaserControl::Delays, "part-mach4.nc"),
        ("rtc", LaserControl::Delays, "part-rtc.csv"),
    ] {
        let options = PostOptions { control, pitch_um: Some(20.0), ..PostOptions::default() };
        let format = ProgramFormat::of_name(dialect)?;
        let (written, vectors) =
            postprocess_text(&head, &knowledge, &options, ("part.apt", &job), format, 255.0)?;
        let golden = golden(name, Some(&written))?;
        assert_eq!(written, golden, "{name}");
        assert!(vectors > 8);
        // The arc is rounded off by the lag; straight strokes longer than the beam are right.
        let mut right = 0;
        let program = AnyProgram::of_name(name, golden.as_bytes(), &head)?;
        simulate(&head, program, None, |stroke| {
            right += u32::from(stroke.length_error_um.abs() < 2.0);
        })?;
        assert!(right >= 6, "{name}: {right}");
    }
    Ok(())
}

#[test]
fn micro_vectors() -> Result<(), Box<dyn Error>> {
    let head = ScanHead::default();
    let knowledge = HeadKnowledge::of_head(&head);
    let job = golden("line.apt", None)?;
    let options = PostOptions { pitch_um: Some(20.0), ..PostOptions::default() };
    let format = ProgramFormat::of_name("rtc-micro-vectors")?;
    let (written, _) =
        postprocess_text(&head, &knowledge, &options, ("line.apt", &job), format, 255.0)?;
    let golden = golden("line-micro-vectors.csv", Some(&written))?;
    assert_eq!(written, golden);
    let program = AnyProgram::of_name("line-micro-vectors.csv", golden.as_bytes(), &head)?;
    let mut pulses = Vec::new();
    simulate(&head, program, None, |stroke| {
        assert!(stroke.length_error_um.abs() < 2.0, "{stroke:?}");
        pulses.push(stroke.pulses);
    })?;
    // 160 µm between the centres of the outer craters, every 20 µm; and one crater.
    assert_eq!(pulses, [9, 1]);
    Ok(())
}
