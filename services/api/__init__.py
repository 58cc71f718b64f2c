"""The REST calls under `/v1`: thin routes over services, one module a noun."""
