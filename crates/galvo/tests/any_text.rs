//! Any text as a job or a program gives steps or an error with a place, never anything else.

use lasergym_galvo::{
    HeadKnowledge, JobReader, PostOptions, ProgramFormat, ProgramReader, ScanHead,
    postprocess_text, simulate,
};
use proptest::prelude::*;

/// Pieces of cutter-location files.
const APT: [&str; 24] = [
    "GOTO/", "FROM/", "GODLTA/", "CIRCLE/", "RAPID", "FEDRAT/", "UNITS/", "MM", "INCHES", "MMPM",
    "IPM", "FINI", "PARTNO x", "$", "$$", "\n", "\n", ",", "0", "1.5", "-2", "1e-3", " ", "é",
];

/// Pieces of programs.
const GCODE: [&str; 30] = [
    "G0",
    "G1",
    "G2",
    "G3",
    "G4",
    "G20",
    "G21",
    "G90",
    "G91",
    "M3",
    "M4",
    "M5",
    "M2",
    "M67 E0",
    "X",
    "Y",
    "I",
    "J",
    "R",
    "F600",
    "S9",
    "Q1",
    "P0.1",
    "\n",
    "\n",
    "1",
    "-0.5",
    "(lasergym mark_us=",
    ")",
    ";",
];

fn text_of(pieces: &'static [&'static str]) -> impl Strategy<Value = String> {
    let piece = prop_oneof![
        9 => proptest::sample::select(pieces).prop_map(str::to_owned),
        1 => ".{0,3}",
    ];
    proptest::collection::vec(piece, 0..60).prop_map(|pieces| pieces.concat())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn jobs(text in text_of(&APT)) {
        let mut reader = JobReader::of_name("a.apt", text.as_bytes()).unwrap();
        loop {
            match reader.next_step() {
                Ok(Some(_)) => {}
                Ok(None) => break,
                Err(error) => {
                    prop_assert!(error.to_string().starts_with("line "), "{error}");
                    break;
                }
            }
        }
    }

    #[test]
    fn programs(text in text_of(&GCODE)) {
        let head = ScanHead::default();
        for rtc in [false, true] {
            let mut reader = if rtc {
                ProgramReader::rtc_list(text.as_bytes(), &head)
            } else {
                ProgramReader::gcode(text.as_bytes(), &head)
            };
            while let Ok(Some(_)) = reader.next_step() {}
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn straight_jobs_come_out_as_drawn_and_are_read_again(
        lines in proptest::collection::vec(
            (-6.0..6.0_f64, -6.0..6.0_f64, 0.1..3.0_f64, 0.0..6.28_f64), 1..6),
        speed in 0.2..2.5_f64,
        inline: bool,
    ) {
        let mut job = format!("FEDRAT/{},MMPM\n", speed * 60e3);
        for &(x, y, length, angle) in &lines {
            let (dx, dy) = (length * angle.cos(), length * angle.sin());
            job += &format!("RAPID\nGOTO/{x},{y}\nGOTO/{},{}\n", x + dx, y + dy);
        }
        let head = ScanHead::default();
        let knowledge = HeadKnowledge::of_head(&head);
        let control = if inline {
            lasergym_galvo::LaserControl::Inline
        } else {
            lasergym_galvo::LaserControl::Delays
        };
        let options = PostOptions { control, pitch_um: Some(20.0), ..PostOptions::default() };
        let format = ProgramFormat::of_name("grbl").unwrap();
        let (text, _) =
            postprocess_text(&head, &knowledge, &options, ("a.apt", &job), format, 255.0).unwrap();
        let mut worst: f64 = 0.0;
        let reader = ProgramReader::gcode(text.as_bytes(), &head);
        let (report, _) = simulate(&head, reader, None, |stroke| {
            worst = worst.max(stroke.length_error_um.abs());
        })
        .unwrap();
        prop_assert_eq!(report.strokes, lines.len() as u64);
        // Laser delays count in 0.5 µs, which the beam crosses in 1.25 µm at 2.5 m/s.
        prop_assert!(worst < 2.0 * speed.max(1.0), "{worst} µm at {speed} m/s");
    }
}
