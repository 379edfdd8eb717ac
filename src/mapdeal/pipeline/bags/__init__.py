"""What commands do with bags: grids, scans and clouds out of them, and where sensors were."""
