//! Any text is refused with a line and a reason, or makes a model on which the algorithms run.
#![no_main]

use dynamics::{Base, Data, Instructions, Model, UrdfOptions, aba, crba, neutral, rnea};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    for base in [Base::Fixed, Base::Floating] {
        let options = UrdfOptions {
            base,
            independent: vec!["j".into()],
        };
        match Model::from_urdf_with(text, "fuzz.urdf", &options) {
            Err(error) => {
                assert!(error.line > 0 && error.line <= text.split('\n').count());
                assert!(!error.reason.is_empty());
            }
            Ok(mut model) => {
                model.apply_rotor_inertias();
                exercise(&model);
            }
        }
    }
});

fn exercise(model: &Model) {
    let (q, v) = (neutral(model), vec![0.5; model.nv()]);
    for instructions in [Instructions::Portable, Instructions::detect()] {
        let mut data = Data::new(model);
        data.set_instructions(instructions);
        let tau = rnea(model, &mut data, &q, &v, &v, None).to_vec();
        assert_eq!(tau.len(), model.nv());
        crba(model, &mut data, &q);
        aba(model, &mut data, &q, &v, &tau, None);
    }
}
