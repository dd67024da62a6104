//! One CMA-ES run as ask and tell.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::covariance::Covariance;
use super::error::CmaEsError;
use super::options::CmaEsOptions;
use super::parameters::StrategyParameters;
use super::termination::{CostHistory, Snapshot, Termination};

/// The largest ln of a change of the step size in one generation.
const MAX_LN_SIGMA_STEP: f64 = 1.0;

/// The best candidate of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Best<'a> {
    /// The candidate, length n, inside the bounds.
    pub x: &'a [f64],
    /// Its cost.
    pub cost: f64,
}

/// A CMA-ES run: [`CmaEs::ask`] draws a population, [`CmaEs::tell`] takes its costs and adapts the
/// normal distribution N(m, σ² C) the next one is drawn from. Costs are minimised, and only their
/// order matters.
///
/// The same start, options and costs give the same populations, bit for bit, on one kind of
/// processor.
///
/// ```
/// use lasergym_plan::{CmaEs, CmaEsOptions};
///
/// let mut optimiser = CmaEs::new(&[3.0, -2.0], 1.0, CmaEsOptions::default())?;
/// while optimiser.termination().is_none() {
///     let costs: Vec<f64> =
///         optimiser.ask().chunks_exact(2).map(|x| x[0].powi(2) + 9.0 * x[1].powi(2)).collect();
///     optimiser.tell(&costs)?;
/// }
/// assert!(optimiser.best().is_some_and(|best| best.cost < 1e-9));
/// # Ok::<(), lasergym_plan::CmaEsError>(())
/// ```
#[derive(Debug, Clone)]
pub struct CmaEs {
    parameters: StrategyParameters,
    options: CmaEsOptions,
    rng: Pcg64,
    initial_sigma: f64,
    sigma: f64,
    /// Mean m in free variables, before folding into the bounds.
    mean: DVector<f64>,
    /// The mean inside the bounds.
    mean_in_bounds: DVector<f64>,
    /// Evolution path `p_σ` of the step size.
    sigma_path: DVector<f64>,
    /// Evolution path `p_c` of the covariance matrix.
    covariance_path: DVector<f64>,
    covariance: Covariance,
    eigen_interval: usize,

    /// Standard normal draws z, one candidate per column, shape (n, λ).
    draws: DMatrix<f64>,
    /// Steps y = B D z, one candidate per column.
    steps: DMatrix<f64>,
    /// w y, in the columns of `steps`.
    weighted: DMatrix<f64>,
    /// Candidates x inside the bounds, one per column.
    population: DMatrix<f64>,
    /// Weighted mean of the steps ⟨y⟩_w, and C^(−1/2) ⟨y⟩_w.
    mean_step: DVector<f64>,
    whitened: DVector<f64>,
    /// Indices of the candidates, best first, and their costs in that order.
    ranking: Vec<usize>,
    sorted_costs: Vec<f64>,

    asked: bool,
    generation: usize,
    evaluations: usize,
    best_x: Vec<f64>,
    best_cost: f64,
    history: CostHistory,
    termination: Option<Termination>,
}

impl CmaEs {
    /// A run from `mean`, of length n, with initial step size `sigma` in every coordinate, in
    /// units of the variables. The optimum is best expected within about 3 `sigma` of `mean`.
    ///
    /// # Errors
    /// A [`CmaEsError`] naming the first invalid value of the arguments.
    pub fn new(mean: &[f64], sigma: f64, options: CmaEsOptions) -> Result<Self, CmaEsError> {
        options.validate(mean, sigma)?;
        let n = mean.len();
        let lambda = options.population_size_for(n);
        let parameters = StrategyParameters::new(n, lambda, options.covariance_update);
        let mean_in_bounds = DVector::from_column_slice(mean);
        let mut mean = mean_in_bounds.clone();
        if let Some(bounds) = &options.bounds {
            bounds.unfold(mean.as_mut_slice());
        }
        Ok(Self {
            rng: Pcg64::seed_from_u64(options.seed),
            initial_sigma: sigma,
            sigma,
            mean,
            mean_in_bounds,
            sigma_path: DVector::zeros(n),
            covariance_path: DVector::zeros(n),
            covariance: Covariance::identity(n),
            eigen_interval: parameters.eigen_interval(),
            draws: DMatrix::zeros(n, lambda),
            steps: DMatrix::zeros(n, lambda),
            weighted: DMatrix::zeros(n, lambda),
            population: DMatrix::zeros(n, lambda),
            mean_step: DVector::zeros(n),
            whitened: DVector::zeros(n),
            ranking: Vec::with_capacity(lambda),
            sorted_costs: Vec::with_capacity(lambda),
            asked: false,
            generation: 0,
            evaluations: 0,
            best_x: vec![f64::NAN; n],
            best_cost: f64::INFINITY,
            history: CostHistory::default(),
            termination: None,
            parameters,
            options,
        })
    }

    /// Draws the candidates of this generation: λ × n values, one candidate after another, all
    /// inside the bounds. Until [`CmaEs::tell`] it returns the same candidates again.
    pub fn ask(&mut self) -> &[f64] {
        if !self.asked {
            self.sample();
            self.asked = true;
        }
        self.population.as_slice()
    }

    /// Takes the costs of the candidates last asked for, in their order, and adapts the
    /// distribution. Lower is better; NaN counts as infinitely bad.
    ///
    /// A caller may go on after [`CmaEs::termination`] has named a reason.
    ///
    /// # Errors
    /// [`CmaEsError::TellBeforeAsk`], [`CmaEsError::CostsLength`] unless there are λ costs,
    /// [`CmaEsError::AllCostsNan`]. The run is unchanged and the costs can be told again.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), CmaEsError> {
        let population_size = self.parameters.population_size;
        if !self.asked {
            return Err(CmaEsError::TellBeforeAsk);
        }
        if costs.len() != population_size {
            return Err(CmaEsError::CostsLength { costs: costs.len(), population_size });
        }
        if costs.iter().all(|cost| cost.is_nan()) {
            return Err(CmaEsError::AllCostsNan { generation: self.generation });
        }
        self.asked = false;
        self.generation += 1;
        self.evaluations += population_size;
        self.rank(costs);
        self.keep_best();
        self.adapt();
        self.termination = self.find_termination();
        Ok(())
    }

    /// The best candidate told so far; `None` before the first [`CmaEs::tell`].
    #[must_use]
    pub fn best(&self) -> Option<Best<'_>> {
        (self.generation > 0).then_some(Best { x: &self.best_x, cost: self.best_cost })
    }

    /// Mean m of the distribution, length n, inside the bounds. With a noisy cost it is a better
    /// estimate of the optimum than the best candidate.
    #[must_use]
    pub fn mean(&self) -> &[f64] {
        self.mean_in_bounds.as_slice()
    }

    /// Step size σ, in units of the variables.
    #[must_use]
    pub fn sigma(&self) -> f64 {
        self.sigma
    }

    /// Number of variables n.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.parameters.dimension
    }

    /// Candidates per generation λ.
    #[must_use]
    pub fn population_size(&self) -> usize {
        self.parameters.population_size
    }

    /// The strategy parameters in use.
    #[must_use]
    pub fn parameters(&self) -> &StrategyParameters {
        &self.parameters
    }

    /// Generations told.
    #[must_use]
    pub fn generation(&self) -> usize {
        self.generation
    }

    /// Costs told.
    #[must_use]
    pub fn evaluations(&self) -> usize {
        self.evaluations
    }

    /// Lowest cost of the generation last told; infinite before the first.
    #[must_use]
    pub fn generation_best_cost(&self) -> f64 {
        self.sorted_costs.first().copied().unwrap_or(f64::INFINITY)
    }

    /// The stopping criterion met by the generation last told, if any.
    #[must_use]
    pub fn termination(&self) -> Option<Termination> {
        self.termination
    }

    /// x = m + σ B D z, eqs. (38) to (40), brought into the bounds.
    fn sample(&mut self) {
        for z in &mut self.draws {
            *z = self.rng.sample(StandardNormal);
        }
        self.steps.gemm(1.0, self.covariance.axes(), &self.draws, 0.0);
        for (mut x, y) in self.population.column_iter_mut().zip(self.steps.column_iter()) {
            place(x.as_mut_slice(), &self.mean, self.sigma, y.as_slice());
        }
        if let Some(bounds) = &self.options.bounds {
            for x in self.population.as_mut_slice().chunks_exact_mut(self.parameters.dimension) {
                bounds.fold(x);
            }
        }
    }

    /// Orders the candidates by cost; equal costs keep the order of the population.
    fn rank(&mut self, costs: &[f64]) {
        let cost = |k: usize| if costs[k].is_nan() { f64::INFINITY } else { costs[k] };
        self.ranking.clear();
        self.ranking.extend(0..costs.len());
        // No cost is NaN here, and unlike total_cmp this holds −0 and 0 equal.
        self.ranking.sort_unstable_by(|&a, &b| {
            cost(a).partial_cmp(&cost(b)).unwrap_or(std::cmp::Ordering::Equal).then(a.cmp(&b))
        });
        self.sorted_costs.clear();
        self.sorted_costs.extend(self.ranking.iter().map(|&k| cost(k)));
    }

    fn keep_best(&mut self) {
        if self.generation == 1 || self.sorted_costs[0] < self.best_cost {
            self.best_cost = self.sorted_costs[0];
            self.best_x.copy_from_slice(self.population.column(self.ranking[0]).as_slice());
        }
    }

    /// Eqs. (41) to (47).
    fn adapt(&mut self) {
        self.weigh();
        let p = &self.parameters;
        let n = p.dimension as f64;

        // Eq. (42).
        self.mean.axpy(p.c_m * self.sigma, &self.mean_step, 1.0);
        self.mean_in_bounds.copy_from(&self.mean);
        if let Some(bounds) = &self.options.bounds {
            bounds.fold(self.mean_in_bounds.as_mut_slice());
        }

        // Eqs. (43), (44).
        self.covariance.whiten(&self.mean_step, &mut self.whitened);
        let gain = (p.c_sigma * (2.0 - p.c_sigma) * p.mu_eff).sqrt();
        self.sigma_path.axpy(gain, &self.whitened, 1.0 - p.c_sigma);
        let length = self.sigma_path.norm();
        let ln_step = p.c_sigma / p.d_sigma * (length / p.expected_norm - 1.0);
        self.sigma *= ln_step.min(MAX_LN_SIGMA_STEP).exp();

        // Eq. (45); h_σ stalls the path while the step size is growing fast.
        let settled = (1.0 - (1.0 - p.c_sigma).powf(2.0 * self.generation as f64)).sqrt();
        let stalled = length / settled >= (1.4 + 2.0 / (n + 1.0)) * p.expected_norm;
        let gain = if stalled { 0.0 } else { (p.c_c * (2.0 - p.c_c) * p.mu_eff).sqrt() };
        self.covariance_path.axpy(gain, &self.mean_step, 1.0 - p.c_c);

        // Eq. (47).
        let lost = if stalled { p.c_1 * p.c_c * (2.0 - p.c_c) } else { 0.0 };
        let decay = 1.0 + lost - p.c_1 - p.c_mu * p.weights.iter().sum::<f64>();
        self.covariance.update(decay, p.c_1, &self.covariance_path, &self.weighted, &self.steps);
    }

    /// Sets `mean_step` to ⟨y⟩_w, eq. (41), and the columns of `weighted` to `c_μ` w° y, eq. (46).
    fn weigh(&mut self) {
        let p = &self.parameters;
        self.mean_step.fill(0.0);
        for (rank, &k) in self.ranking.iter().enumerate() {
            let y = self.steps.column(k);
            let mut weight = p.weights[rank];
            if rank < p.parents {
                self.mean_step.axpy(weight, &y, 1.0);
            } else if weight < 0.0 {
                // ‖C^(−1/2) y‖ = ‖z‖ for y = B D z.
                let length_squared = self.draws.column(k).norm_squared();
                weight *=
                    if length_squared > 0.0 { p.dimension as f64 / length_squared } else { 0.0 };
            }
            let mut weighted = self.weighted.column_mut(k);
            weighted.copy_from(&y);
            weighted *= p.c_mu * weight;
        }
    }

    /// Refreshes the principal axes when due and tests the stopping criteria.
    fn find_termination(&mut self) -> Option<Termination> {
        let due = self.generation.is_multiple_of(self.eigen_interval);
        if due && self.covariance.refresh().is_err() {
            return Some(Termination::NotFinite);
        }
        self.history.push(&self.sorted_costs);
        let state = Snapshot {
            generation: self.generation,
            evaluations: self.evaluations,
            population_size: self.parameters.population_size,
            best_cost: self.best_cost,
            sorted_costs: &self.sorted_costs,
            mean: &self.mean,
            sigma: self.sigma,
            initial_sigma: self.initial_sigma,
            covariance_path: &self.covariance_path,
            covariance: &self.covariance,
        };
        self.history.check(&state, &self.options)
    }
}

/// Writes `mean` + `sigma` `step` to `x`.
fn place(x: &mut [f64], mean: &DVector<f64>, sigma: f64, step: &[f64]) {
    for (x, (&m, &y)) in x.iter_mut().zip(mean.iter().zip(step)) {
        *x = m + sigma * y;
    }
}
