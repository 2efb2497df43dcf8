# `docker build -t tire_dynamics . && docker run --rm tire_dynamics`: the demonstration, with the core compiled.
FROM python:3.12-slim
RUN apt-get update && apt-get install -y --no-install-recommends cmake g++ git make && rm -rf /var/lib/apt/lists/*
WORKDIR /tire_dynamics
COPY . .
RUN make .venv/ready
CMD ["make", "run"]
