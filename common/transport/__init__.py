"""The bus between processes, its access rules, clock and trace."""
