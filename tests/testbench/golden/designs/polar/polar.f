+incdir+include
rotation.v
polar.v
