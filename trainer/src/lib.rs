//! Off-line training of the leg's actor by deep deterministic policy gradient (DDPG).
