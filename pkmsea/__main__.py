from pkmsea.cli import main

main()
