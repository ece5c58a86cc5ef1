//! Any text is refused with a line or makes a model whose dynamics are numbers.
#![no_main]

use dynamics::{Base, Data, Model, neutral, rnea};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    for base in [Base::Fixed, Base::Floating] {
        match Model::from_urdf(text, "fuzz.urdf", base) {
            Err(error) => {
                assert!(error.line > 0);
                assert!(!error.reason.is_empty());
            }
            Ok(model) => {
                let mut data = Data::new(&model);
                let (q, v) = (neutral(&model), vec![0.5; model.nv()]);
                rnea(&model, &mut data, &q, &v, &v, None);
            }
        }
    }
});
