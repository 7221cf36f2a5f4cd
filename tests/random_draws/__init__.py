"""Random plants, switched plants and malformed calls: does what invtrack hands out or refuses stand up to independent judgement?

python -m tests.random_draws                      # 10^4 plants, 10^3 switched plants, 10^4 malformed calls
python -m tests.random_draws --plants 200 --switched 0 --calls 0 --seed 3
python -m tests.random_draws --plants 1 --first 4711 --switched 0 --calls 0    # one draw, by its number

From the checkout's folder. docs/random-draws.md says what is drawn, how it is judged and what a run showed.
"""
