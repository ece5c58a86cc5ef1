//! Values of keys that are lists: texts, numbers, pairs, square matrices.

use super::{Allowed, At, Section};
use toml::Spanned;
use toml::de::DeValue;

impl<'n, 't> Section<'n, 't> {
    /// `N` texts, or nothing if there was a problem.
    pub(crate) fn text_array<const N: usize>(
        &self,
        key: &'static str,
        allowed: &str,
    ) -> Option<[At<&'n str>; N]> {
        let texts = self.items(key, N, allowed)?;
        let texts: Vec<_> = texts
            .iter()
            .filter_map(|item| self.as_text(key, item, allowed))
            .collect();
        texts.try_into().ok()
    }

    /// `N` numbers; NaN stands for those with a problem.
    pub(crate) fn number_array_or<const N: usize>(
        &self,
        key: &'static str,
        default: [f64; N],
        allowed: Allowed,
    ) -> [f64; N] {
        if !self.has(key) {
            self.default(key, default);
            return default;
        }
        let mut numbers = [f64::NAN; N];
        if let Some(items) = self.items(key, N, &format!("{N} numbers, each {allowed}")) {
            for (number, item) in numbers.iter_mut().zip(items) {
                *number = self.as_number(key, item, allowed);
            }
        }
        numbers
    }

    /// Pairs of finite numbers; none if the key is missing.
    pub(crate) fn pairs(&self, key: &'static str) -> Vec<(f64, f64)> {
        const ALLOWED: &str = "a list of pairs of finite numbers, as [[0.1, -0.2], [0.0, 0.3]]";
        let Some(value) = self.find(key) else {
            return Vec::new();
        };
        let Some(items) = value.get_ref().as_array() else {
            self.wrong(key, value, &ALLOWED);
            return Vec::new();
        };
        let pair = |item: &'n Spanned<DeValue<'t>>| match item.get_ref().as_array() {
            Some(pair) if pair.len() == 2 => {
                let [a, b] = [0, 1].map(|i| self.as_number(key, &pair[i], Allowed::Finite));
                (a, b)
            }
            _ => {
                self.wrong(key, item, &ALLOWED);
                (f64::NAN, f64::NAN)
            }
        };
        items.iter().map(pair).collect()
    }

    /// Points of three finite numbers; none if the key is missing.
    pub(crate) fn points(&self, key: &'static str) -> Vec<[f64; 3]> {
        const ALLOWED: &str = "a list of points of three finite numbers, as [[0.1, 0.05, -0.05], [0.1, -0.05, -0.05]]";
        let Some(value) = self.find(key) else {
            return Vec::new();
        };
        let Some(items) = value.get_ref().as_array() else {
            self.wrong(key, value, &ALLOWED);
            return Vec::new();
        };
        let point = |item: &'n Spanned<DeValue<'t>>| match item.get_ref().as_array() {
            Some(point) if point.len() == 3 => {
                [0, 1, 2].map(|i| self.as_number(key, &point[i], Allowed::Finite))
            }
            _ => {
                self.wrong(key, item, &ALLOWED);
                [f64::NAN; 3]
            }
        };
        items.iter().map(point).collect()
    }

    fn items(
        &self,
        key: &'static str,
        count: usize,
        allowed: &str,
    ) -> Option<&'n [Spanned<DeValue<'t>>]> {
        let Some(value) = self.find(key) else {
            self.missing(key, allowed);
            return None;
        };
        match value.get_ref() {
            DeValue::Array(items) if items.len() == count => Some(items),
            DeValue::Array(items) => {
                let what = format!("{} values are not allowed", items.len());
                self.problem(key, what, allowed);
                None
            }
            _ => {
                self.wrong(key, value, &allowed);
                None
            }
        }
    }

    /// A text, or a list of texts; none if the key is missing.
    pub(crate) fn optional_texts(&self, key: &'static str, allowed: &str) -> Vec<At<&'n str>> {
        match self.find(key).map(Spanned::get_ref) {
            None => Vec::new(),
            Some(DeValue::Array(items)) if items.is_empty() => Vec::new(),
            Some(_) => self.texts(key, allowed),
        }
    }

    /// A text, or a list of texts.
    pub(crate) fn texts(&self, key: &'static str, allowed: &str) -> Vec<At<&'n str>> {
        match self.find(key) {
            None => {
                self.missing(key, allowed);
                Vec::new()
            }
            Some(value) => match value.get_ref() {
                DeValue::Array(items) if !items.is_empty() => items
                    .iter()
                    .filter_map(|item| self.as_text(key, item, allowed))
                    .collect(),
                _ => self.as_text(key, value, allowed).into_iter().collect(),
            },
        }
    }

    /// An `N` by `N` matrix of finite numbers, a list of rows; NaN stands for numbers
    /// with a problem.
    pub(crate) fn matrix_or<const N: usize>(
        &self,
        key: &'static str,
        default: [[f64; N]; N],
    ) -> [[f64; N]; N] {
        if !self.has(key) {
            self.default(key, default);
            return default;
        }
        let allowed = format!("a list of {N} rows, each a list of {N} finite numbers");
        let mut matrix = [[f64::NAN; N]; N];
        let rows = self.items(key, N, &allowed).unwrap_or_default();
        for (row, item) in matrix.iter_mut().zip(rows) {
            match item.get_ref().as_array() {
                Some(numbers) if numbers.len() == N => {
                    for (number, item) in row.iter_mut().zip(numbers.iter()) {
                        *number = self.as_number(key, item, Allowed::Finite);
                    }
                }
                _ => self.wrong(key, item, &allowed),
            }
        }
        matrix
    }
}
