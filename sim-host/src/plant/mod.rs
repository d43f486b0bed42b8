//! The spring-legged hopper (SLIP/USLIP) in any medium.
